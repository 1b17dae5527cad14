//! Unix sockets of type `SOCK_SEQPACKET`: each packet is one message, with descriptors beside it. Every wait
//! has a limit.

#![expect(unsafe_code, reason = "a socket option's edge")]

use crate::error::InteropError;
use crate::wire::{ErrorCode, MAX_BYTES, MAX_FDS, Message, Version};
use rustix::event::{PollFd, PollFlags, Timespec, poll};
use rustix::fd::{AsFd, AsRawFd, BorrowedFd, OwnedFd};
use rustix::fs::{FileType, Mode, Stat};
use rustix::io::Errno;
use rustix::net::{
    AddressFamily, RecvAncillaryBuffer, RecvAncillaryMessage, RecvFlags, ReturnFlags, SendAncillaryBuffer,
    SendAncillaryMessage, SendFlags, SocketAddrUnix, SocketFlags, SocketType, accept_with, bind, connect,
    listen, recvmsg, sendmsg, socket_with,
};
use std::io::{IoSlice, IoSliceMut};
use std::mem::MaybeUninit;
use std::path::{Path, PathBuf};
use std::sync::{Mutex, OnceLock, PoisonError};
use std::time::{Duration, Instant};

/// A connection.
pub(crate) struct Socket {
    fd: OwnedFd,
    /// What is spoken, once that is agreed.
    version: OnceLock<Version>,
    /// Room for the longest message, and one byte more to notice a longer one.
    room: Mutex<Vec<u8>>,
}

/// Who is at the other end, as the kernel says.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Credentials {
    pub user: u32,
    /// 0 if the process is in a container that this one does not see into.
    pub process: i32,
}

/// Who is at the other end of a connection.
fn credentials(fd: &OwnedFd) -> std::io::Result<Credentials> {
    let mut peer = libc::ucred { pid: 0, uid: 0, gid: 0 };
    let mut bytes = size_of::<libc::ucred>() as libc::socklen_t;
    // SAFETY: the descriptor is open, and the kernel writes at most `bytes` bytes of a `ucred` to `peer`.
    let result = unsafe {
        libc::getsockopt(
            fd.as_raw_fd(),
            libc::SOL_SOCKET,
            libc::SO_PEERCRED,
            (&raw mut peer).cast(),
            &raw mut bytes,
        )
    };
    if result == 0 {
        Ok(Credentials { user: peer.uid, process: peer.pid })
    } else {
        Err(std::io::Error::last_os_error())
    }
}

/// What a look for a new connection gave.
pub(crate) enum Accepted {
    /// Nobody waits.
    Nobody,
    /// A connection.
    One(Socket, Credentials),
    /// Somebody waits, but the system has no descriptor or memory for a connection now.
    NoRoom(Errno),
}

/// What an error of `accept4` means for the listener.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum AcceptError {
    /// Nobody waits.
    Nobody,
    /// This connection is gone or the call was interrupted; look again.
    Again,
    /// The system is short of something; look again later.
    NoRoom,
    /// The listener itself is broken.
    Broken,
}

impl AcceptError {
    fn of(errno: Errno) -> Self {
        match errno {
            Errno::AGAIN => AcceptError::Nobody,
            Errno::INTR | Errno::CONNABORTED => AcceptError::Again,
            Errno::BADF | Errno::FAULT | Errno::INVAL | Errno::NOTSOCK | Errno::OPNOTSUPP => {
                AcceptError::Broken
            }
            // MFILE, NFILE, NOBUFS and NOMEM pass; so may whatever else the kernel says of one connection.
            _ => AcceptError::NoRoom,
        }
    }
}

/// A packet and the descriptors that came with it.
pub(crate) struct Received {
    pub bytes: Vec<u8>,
    pub fds: Vec<OwnedFd>,
    agreed: Option<Version>,
}

impl Received {
    /// The message. Before a version is agreed it may be of any.
    pub(crate) fn message(&self) -> Result<Message, InteropError> {
        let version = self.agreed.map_or_else(|| self.version(), Ok)?;
        Ok(Message::parse(version, &self.bytes, self.fds.len())?)
    }

    /// Its version.
    pub(crate) fn version(&self) -> Result<Version, InteropError> {
        Ok(Version::of(&self.bytes)?)
    }
}

fn new_socket() -> Result<OwnedFd, InteropError> {
    let flags = SocketFlags::CLOEXEC | SocketFlags::NONBLOCK;
    socket_with(AddressFamily::UNIX, SocketType::SEQPACKET, flags, None)
        .map_err(InteropError::system("socket"))
}

fn address(path: &Path) -> Result<SocketAddrUnix, InteropError> {
    SocketAddrUnix::new(path).map_err(|error| match error {
        Errno::NAMETOOLONG => {
            fault(path, "the path is longer than the 107 bytes that a socket's may have".to_owned())
        }
        error => fault(path, error.to_string()),
    })
}

fn fault(path: &Path, reason: String) -> InteropError {
    InteropError::Socket { path: path.to_owned(), reason }
}

impl Socket {
    fn new(fd: OwnedFd) -> Self {
        Socket { fd, version: OnceLock::new(), room: Mutex::new(vec![0; MAX_BYTES + 1]) }
    }

    /// Agrees on a version, once.
    pub(crate) fn speak(&self, version: Version) {
        // A second HELLO is out of turn and changes nothing.
        let _ = self.version.set(version);
    }

    /// Connects to the engine, to speak this version. While more connections wait for the engine than the system
    /// queues, it tries again, until `limit` is over.
    pub(crate) fn connect(path: &Path, version: Version, limit: Duration) -> Result<Self, InteropError> {
        let (fd, address, started) = (new_socket()?, address(path)?, Instant::now());
        while let Err(error) = connect(&fd, &address) {
            let reason = match error {
                // The system tells nobody when there is room again.
                Errno::AGAIN if started.elapsed() < limit => {
                    std::thread::sleep(CROWDED);
                    continue;
                }
                Errno::INTR => continue,
                Errno::AGAIN => format!("the engine had too many connections to answer for {limit:?}"),
                Errno::NOENT => "there is none; start `esaac serve` first".to_owned(),
                Errno::CONNREFUSED => "nobody serves there any more".to_owned(),
                Errno::ACCESS => "it belongs to another user".to_owned(),
                error => error.to_string(),
            };
            return Err(fault(path, reason));
        }
        let socket = Socket::new(fd);
        socket.speak(version);
        Ok(socket)
    }

    /// Sends a message, and waits for room in the peer's queue.
    pub(crate) fn send_within(&self, limit: Duration, message: &Message) -> Result<(), InteropError> {
        let deadline = Instant::now() + limit;
        loop {
            match self.send(message, &[]) {
                Err(InteropError::PeerStalled) if Instant::now() < deadline => {
                    let left = deadline.saturating_duration_since(Instant::now());
                    wait_ready(&[self.fd.as_fd()], PollFlags::OUT, left)?;
                }
                outcome => return outcome,
            }
        }
    }

    /// Sends a message. It is an error if the peer's queue is full. Before a version is agreed it goes out in the first,
    /// which every peer understands.
    pub(crate) fn send(&self, message: &Message, fds: &[BorrowedFd<'_>]) -> Result<(), InteropError> {
        let version = self.version.get().copied().unwrap_or(Version::One);
        let bytes = message.to_bytes(version, fds.len());
        let mut space = [MaybeUninit::uninit(); rustix::cmsg_space!(ScmRights(MAX_FDS))];
        let mut control = SendAncillaryBuffer::new(&mut space);
        if !fds.is_empty() && !control.push(SendAncillaryMessage::ScmRights(fds)) {
            return Err(InteropError::System { call: "sendmsg", source: Errno::MSGSIZE });
        }
        match sendmsg(
            &self.fd,
            &[IoSlice::new(&bytes)],
            &mut control,
            SendFlags::NOSIGNAL | SendFlags::DONTWAIT,
        ) {
            Ok(_) => Ok(()),
            Err(Errno::PIPE | Errno::CONNRESET | Errno::NOTCONN) => Err(InteropError::PeerGone),
            Err(Errno::AGAIN | Errno::NOBUFS) => Err(InteropError::PeerStalled),
            Err(source) => Err(InteropError::System { call: "sendmsg", source }),
        }
    }

    /// The next packet, if there is one.
    pub(crate) fn receive(&self) -> Result<Option<Received>, InteropError> {
        match self.receive_once() {
            // If the peer closed without reading all its messages, Linux reports that once, before it delivers
            // what the peer had sent. The last of these may say why it closed.
            Err(InteropError::PeerGone) => self.receive_once(),
            other => other,
        }
    }

    fn receive_once(&self) -> Result<Option<Received>, InteropError> {
        let mut room = self.room.lock().unwrap_or_else(PoisonError::into_inner);
        let mut space = [MaybeUninit::uninit(); rustix::cmsg_space!(ScmRights(MAX_FDS + 1))];
        let mut control = RecvAncillaryBuffer::new(&mut space);
        let flags = RecvFlags::DONTWAIT | RecvFlags::CMSG_CLOEXEC;
        let got = match recvmsg(&self.fd, &mut [IoSliceMut::new(&mut room)], &mut control, flags) {
            Ok(got) => got,
            Err(Errno::AGAIN | Errno::INTR) => return Ok(None),
            Err(Errno::CONNRESET | Errno::PIPE) => return Err(InteropError::PeerGone),
            Err(source) => return Err(InteropError::System { call: "recvmsg", source }),
        };
        let fds: Vec<OwnedFd> = control
            .drain()
            .filter_map(|message| match message {
                RecvAncillaryMessage::ScmRights(fds) => Some(fds),
                _ => None,
            })
            .flatten()
            .collect();
        // An empty packet reads as the end of the connection does. It is a message that is none.
        if got.bytes == 0 && self.is_hung_up() {
            return Err(InteropError::PeerGone);
        }
        if got.flags.contains(ReturnFlags::CTRUNC) {
            return Err(InteropError::Refused {
                code: ErrorCode::Protocol,
                text: format!("more than {MAX_FDS} descriptors in a message, or none could be taken in"),
            });
        }
        let agreed = self.version.get().copied();
        Ok(Some(Received { bytes: room[..got.bytes].to_vec(), fds, agreed }))
    }

    /// Whether the peer sends no more. If the kernel does not say, it does not.
    fn is_hung_up(&self) -> bool {
        let mut polled = [PollFd::new(&self.fd, PollFlags::RDHUP)];
        poll(&mut polled, Some(&Timespec::default())).is_err() || !polled[0].revents().is_empty()
    }

    /// Waits for the next packet.
    pub(crate) fn receive_within(
        &self,
        limit: Duration,
        what: &'static str,
    ) -> Result<Received, InteropError> {
        let deadline = Instant::now() + limit;
        loop {
            if let Some(received) = self.receive()? {
                return Ok(received);
            }
            let left = deadline.saturating_duration_since(Instant::now());
            if left.is_zero() {
                return Err(InteropError::Timeout { what, limit });
            }
            wait_readable(&[self.fd.as_fd()], left)?;
        }
    }

    pub(crate) fn as_fd(&self) -> BorrowedFd<'_> {
        self.fd.as_fd()
    }
}

/// Before the next look when the kernel has no memory for one.
const SHORTAGE: Duration = Duration::from_millis(10);

/// Before the next try to connect to an engine whose queue of connections is full.
const CROWDED: Duration = Duration::from_millis(5);

/// Waits until one of `fds` can be read or is closed, and says which.
pub(crate) fn wait_readable(fds: &[BorrowedFd<'_>], limit: Duration) -> Result<Vec<bool>, InteropError> {
    wait_ready(fds, PollFlags::IN, limit)
}

fn wait_ready(fds: &[BorrowedFd<'_>], what: PollFlags, limit: Duration) -> Result<Vec<bool>, InteropError> {
    let mut polled: Vec<PollFd<'_>> = fds.iter().map(|fd| PollFd::from_borrowed_fd(*fd, what)).collect();
    let timeout = Timespec { tv_sec: limit.as_secs() as i64, tv_nsec: i64::from(limit.subsec_nanos()) };
    match poll(&mut polled, Some(&timeout)) {
        Ok(_) | Err(Errno::INTR) => Ok(polled.iter().map(|fd| !fd.revents().is_empty()).collect()),
        // The kernel is short of memory for a moment: as if nothing had come.
        Err(Errno::NOMEM | Errno::AGAIN) => {
            std::thread::sleep(limit.min(SHORTAGE));
            Ok(vec![false; fds.len()])
        }
        Err(source) => Err(InteropError::System { call: "poll", source }),
    }
}

/// The socket that producers connect to. Its file is removed with it.
pub(crate) struct Listener {
    fd: OwnedFd,
    path: PathBuf,
    file: FileId,
}

/// Tells a socket's file from another one that has come to its path since. The system gives the number to no other file
/// while the socket is open.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct FileId {
    device: u64,
    inode: u64,
}

impl FileId {
    fn of(stat: &Stat) -> Self {
        FileId { device: stat.st_dev, inode: stat.st_ino }
    }

    /// Removes the file, unless another one is at `path`.
    fn unlink(self, path: &Path) -> rustix::io::Result<()> {
        match rustix::fs::lstat(path) {
            Ok(stat) if FileId::of(&stat) == self => rustix::fs::unlink(path),
            Ok(_) | Err(Errno::NOENT) => Ok(()),
            Err(error) => Err(error),
        }
    }
}

impl Listener {
    /// Makes the socket, for this user alone, with a queue for so many connections that nobody has answered yet. It
    /// replaces the file that a dead engine has left at `path`.
    pub(crate) fn bind(path: &Path, queue: usize) -> Result<Self, InteropError> {
        let address = address(path)?;
        let folder = match path.parent() {
            Some(parent) if !parent.as_os_str().is_empty() => parent,
            _ => Path::new("."),
        };
        let stat = rustix::fs::stat(folder)
            .map_err(|error| fault(path, format!("folder {}: {error}", folder.display())))?;
        let mode = Mode::from_raw_mode(stat.st_mode);
        if mode.intersects(Mode::WGRP | Mode::WOTH) || stat.st_uid != rustix::process::geteuid().as_raw() {
            return Err(fault(
                path,
                format!(
                    "others may write in folder {0}; take one of your own: mkdir -m 700 {0}/esaac",
                    folder.display()
                ),
            ));
        }
        clear_way(path, &address)?;
        let fd = new_socket()?;
        bind(&fd, &address).map_err(|error| fault(path, error.to_string()))?;
        let stat = rustix::fs::lstat(path).map_err(|error| fault(path, error.to_string()))?;
        let listener = Listener { fd, path: path.to_owned(), file: FileId::of(&stat) };
        // The socket does not listen yet, so nobody can have connected before this.
        rustix::fs::chmod(path, Mode::RUSR | Mode::WUSR).map_err(|error| fault(path, error.to_string()))?;
        let queue = i32::try_from(queue).unwrap_or(i32::MAX);
        listen(&listener.fd, queue).map_err(|error| fault(path, error.to_string()))?;
        Ok(listener)
    }

    /// The next connection and who it is from, if somebody waits.
    pub(crate) fn accept(&self) -> Result<Accepted, InteropError> {
        let flags = SocketFlags::CLOEXEC | SocketFlags::NONBLOCK;
        loop {
            match accept_with(&self.fd, flags) {
                Ok(fd) => {
                    // One whose kernel does not say who it is from is closed.
                    if let Ok(peer) = credentials(&fd) {
                        return Ok(Accepted::One(Socket::new(fd), peer));
                    }
                }
                Err(source) => match AcceptError::of(source) {
                    AcceptError::Nobody => return Ok(Accepted::Nobody),
                    AcceptError::Again => {}
                    AcceptError::NoRoom => return Ok(Accepted::NoRoom(source)),
                    AcceptError::Broken => return Err(InteropError::System { call: "accept4", source }),
                },
            }
        }
    }

    pub(crate) fn as_fd(&self) -> BorrowedFd<'_> {
        self.fd.as_fd()
    }
}

impl Drop for Listener {
    fn drop(&mut self) {
        // Who ends has nobody to tell; the next engine replaces what is left.
        let _ = self.file.unlink(&self.path);
    }
}

/// Removes the socket of an engine that is gone. Anything else at `path` is an error.
fn clear_way(path: &Path, address: &SocketAddrUnix) -> Result<(), InteropError> {
    let Ok(stat) = rustix::fs::lstat(path) else { return Ok(()) };
    if FileType::from_raw_mode(stat.st_mode) != FileType::Socket {
        return Err(fault(path, "there is a file of this name that is no socket".to_owned()));
    }
    match connect(&new_socket()?, address) {
        Err(Errno::CONNREFUSED) => {
            FileId::of(&stat).unlink(path).map_err(|error| fault(path, error.to_string()))
        }
        _ => Err(fault(path, "another engine serves there; choose another path".to_owned())),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_a_broken_listener_ends_the_service() {
        for errno in [Errno::MFILE, Errno::NFILE, Errno::NOBUFS, Errno::NOMEM, Errno::PERM] {
            assert_eq!(AcceptError::of(errno), AcceptError::NoRoom, "{errno}");
        }
        for errno in [Errno::INTR, Errno::CONNABORTED] {
            assert_eq!(AcceptError::of(errno), AcceptError::Again, "{errno}");
        }
        for errno in [Errno::BADF, Errno::INVAL, Errno::NOTSOCK] {
            assert_eq!(AcceptError::of(errno), AcceptError::Broken, "{errno}");
        }
        assert_eq!(AcceptError::of(Errno::AGAIN), AcceptError::Nobody);
    }

    #[test]
    fn as_many_connect_at_once_as_the_queue_holds_and_more_wait() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("crowded.sock");
        let listener = Listener::bind(&path, 40).unwrap();
        let connect = |limit| Socket::connect(&path, Version::NEWEST, limit);
        // The system queues one more than it is told to.
        let _waiting: Vec<Socket> = (0..=40).map(|_| connect(Duration::ZERO).unwrap()).collect();
        let limit = Duration::from_millis(20);
        let error = connect(limit).err().expect("the queue is full").to_string();
        assert!(error.contains("too many connections to answer for 20ms"), "{error}");
        std::thread::scope(|scope| {
            let late = scope.spawn(|| connect(Duration::from_secs(20)));
            std::thread::sleep(limit);
            assert!(!late.is_finished(), "the queue is still full");
            assert!(matches!(listener.accept().unwrap(), Accepted::One(..)));
            late.join().unwrap().unwrap();
        });
    }

    #[test]
    fn an_empty_packet_is_not_the_end() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("empty.sock");
        let listener = Listener::bind(&path, 1).unwrap();
        let peer = Socket::connect(&path, Version::NEWEST, Duration::ZERO).unwrap();
        let Accepted::One(own, _) = listener.accept().unwrap() else { panic!("nobody came") };
        for _ in 0..2 {
            rustix::net::send(&peer.fd, &[], SendFlags::NOSIGNAL).unwrap();
        }
        for _ in 0..2 {
            let received = own.receive().unwrap().expect("a packet");
            let error = received.message().unwrap_err();
            assert_eq!(error.code(), ErrorCode::Protocol, "{error}");
        }
        assert!(own.receive().unwrap().is_none(), "there is nothing more");
        drop(peer);
        assert!(matches!(own.receive(), Err(InteropError::PeerGone)));
    }

    #[test]
    fn an_engine_that_ends_leaves_the_socket_of_another_one() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("engine.sock");
        let old = Listener::bind(&path, 1).unwrap();
        std::fs::remove_file(&path).unwrap();
        let new = Listener::bind(&path, 1).unwrap();
        drop(old);
        Socket::connect(&path, Version::NEWEST, Duration::ZERO).unwrap();
        drop(new);
        assert!(!path.exists(), "an engine removes its own");
    }

    /// The kernel gives a process number 0 to one that the asker's container does not see.
    #[test]
    fn a_peer_outside_of_the_container_is_accepted() {
        const SOCKET: &str = "ESAAC_TEST_CONTAINED_SOCKET";
        let own = rustix::process::geteuid();
        if let Some(path) = std::env::var_os(SOCKET) {
            let listener = Listener::bind(Path::new(&path), 1).unwrap();
            assert_eq!(wait_readable(&[listener.as_fd()], Duration::from_secs(20)).unwrap(), [true]);
            let Accepted::One(_, peer) = listener.accept().unwrap() else { panic!("nobody came") };
            assert_eq!(peer, Credentials { user: own.as_raw(), process: 0 });
            return;
        }
        // Only root may make such a container without a namespace of users.
        let users: &[&str] = if own.is_root() { &[] } else { &["--user", "--map-root-user"] };
        let contained = |program: &Path| {
            let mut command = std::process::Command::new("unshare");
            command.args(users).args(["--pid", "--fork", "--"]).arg(program);
            command
        };
        if !contained(Path::new("true")).status().is_ok_and(|status| status.success()) {
            eprintln!("not tested: this system lets nobody make a container with `unshare`");
            return;
        }
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("contained.sock");
        let mut server = contained(&std::env::current_exe().unwrap())
            .args(["--exact", "socket::tests::a_peer_outside_of_the_container_is_accepted"])
            .env(SOCKET, &path)
            .spawn()
            .unwrap();
        let started = Instant::now();
        while Socket::connect(&path, Version::NEWEST, Duration::ZERO).is_err()
            && started.elapsed() < Duration::from_secs(20)
        {
            std::thread::sleep(Duration::from_millis(5));
        }
        assert!(server.wait().unwrap().success());
    }
}
