//! Unix sockets of packets: one message a packet, descriptors beside it, never a wait without an end.

use crate::error::InteropError;
use crate::wire::{ErrorCode, MAX_BYTES, MAX_FDS, Message};
use rustix::event::{PollFd, PollFlags, Timespec, poll};
use rustix::fd::{AsFd, BorrowedFd, OwnedFd};
use rustix::fs::{FileType, Mode};
use rustix::io::Errno;
use rustix::net::{
    AddressFamily, RecvAncillaryBuffer, RecvAncillaryMessage, RecvFlags, ReturnFlags, SendAncillaryBuffer,
    SendAncillaryMessage, SendFlags, SocketAddrUnix, SocketFlags, SocketType, accept_with, bind, connect,
    listen, recvmsg, sendmsg, socket_with, sockopt,
};
use std::io::{IoSlice, IoSliceMut};
use std::mem::MaybeUninit;
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

/// A connection.
pub(crate) struct Socket {
    fd: OwnedFd,
}

/// What came: the packet, and the descriptors beside it.
pub(crate) struct Received {
    pub bytes: Vec<u8>,
    pub fds: Vec<OwnedFd>,
}

impl Received {
    pub(crate) fn message(&self) -> Result<Message, InteropError> {
        Ok(Message::parse(&self.bytes, self.fds.len())?)
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
    /// Connects to the engine.
    pub(crate) fn connect(path: &Path) -> Result<Self, InteropError> {
        let fd = new_socket()?;
        connect(&fd, &address(path)?).map_err(|error| match error {
            Errno::NOENT => fault(path, "there is none; start `esaac serve` first".to_owned()),
            Errno::CONNREFUSED => fault(path, "nobody serves there any more".to_owned()),
            Errno::ACCESS => fault(path, "it belongs to another user".to_owned()),
            Errno::AGAIN => fault(path, "the engine has too many connections to answer".to_owned()),
            error => fault(path, error.to_string()),
        })?;
        Ok(Socket { fd })
    }

    /// Sends a message; the peer must have room for it.
    pub(crate) fn send(&self, message: &Message, fds: &[BorrowedFd<'_>]) -> Result<(), InteropError> {
        let bytes = message.to_bytes(fds.len());
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
            // The peer has left messages unread when it closed. Linux says that first, once, and only then
            // gives what the peer had sent before: its reasons.
            Err(InteropError::PeerGone) => self.receive_once(),
            other => other,
        }
    }

    fn receive_once(&self) -> Result<Option<Received>, InteropError> {
        // One byte more than any message, so that a longer one is seen to be longer.
        let mut bytes = [0_u8; MAX_BYTES + 1];
        let mut space = [MaybeUninit::uninit(); rustix::cmsg_space!(ScmRights(MAX_FDS + 1))];
        let mut control = RecvAncillaryBuffer::new(&mut space);
        let flags = RecvFlags::DONTWAIT | RecvFlags::CMSG_CLOEXEC;
        let got = match recvmsg(&self.fd, &mut [IoSliceMut::new(&mut bytes)], &mut control, flags) {
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
        if got.bytes == 0 {
            return Err(InteropError::PeerGone);
        }
        if got.flags.contains(ReturnFlags::CTRUNC) {
            return Err(InteropError::Refused {
                code: ErrorCode::Protocol,
                text: format!("more than {MAX_FDS} descriptors in a message, or none could be taken in"),
            });
        }
        Ok(Some(Received { bytes: bytes[..got.bytes].to_vec(), fds }))
    }

    /// The next packet, for which it waits.
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

/// Waits until one of `fds` has something to read or is closed; which of them.
pub(crate) fn wait_readable(fds: &[BorrowedFd<'_>], limit: Duration) -> Result<Vec<bool>, InteropError> {
    let mut polled: Vec<PollFd<'_>> =
        fds.iter().map(|fd| PollFd::from_borrowed_fd(*fd, PollFlags::IN)).collect();
    let limit = Timespec { tv_sec: limit.as_secs() as i64, tv_nsec: i64::from(limit.subsec_nanos()) };
    match poll(&mut polled, Some(&limit)) {
        Ok(_) | Err(Errno::INTR) => Ok(polled.iter().map(|fd| !fd.revents().is_empty()).collect()),
        Err(source) => Err(InteropError::System { call: "poll", source }),
    }
}

/// A socket that producers connect to; its file goes with it.
pub(crate) struct Listener {
    fd: OwnedFd,
    path: PathBuf,
}

impl Listener {
    /// Makes the socket, for this user alone. What a dead engine has left at `path` is replaced.
    pub(crate) fn bind(path: &Path) -> Result<Self, InteropError> {
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
        let listener = Listener { fd, path: path.to_owned() };
        // Nobody can have connected yet: it does not listen.
        rustix::fs::chmod(path, Mode::RUSR | Mode::WUSR).map_err(|error| fault(path, error.to_string()))?;
        listen(&listener.fd, 16).map_err(|error| fault(path, error.to_string()))?;
        Ok(listener)
    }

    /// The next connection and its user, if there is one.
    pub(crate) fn accept(&self) -> Result<Option<(Socket, u32)>, InteropError> {
        let flags = SocketFlags::CLOEXEC | SocketFlags::NONBLOCK;
        let fd = match accept_with(&self.fd, flags) {
            Ok(fd) => fd,
            Err(Errno::AGAIN | Errno::INTR | Errno::CONNABORTED) => return Ok(None),
            Err(source) => return Err(InteropError::System { call: "accept4", source }),
        };
        let peer = sockopt::socket_peercred(&fd).map_err(InteropError::system("getsockopt SO_PEERCRED"))?;
        Ok(Some((Socket { fd }, peer.uid.as_raw())))
    }

    pub(crate) fn as_fd(&self) -> BorrowedFd<'_> {
        self.fd.as_fd()
    }
}

impl Drop for Listener {
    fn drop(&mut self) {
        let _ = rustix::fs::unlink(&self.path);
    }
}

/// Removes the socket of an engine that is gone; anything else at `path` is an error.
fn clear_way(path: &Path, address: &SocketAddrUnix) -> Result<(), InteropError> {
    let Ok(stat) = rustix::fs::lstat(path) else { return Ok(()) };
    if FileType::from_raw_mode(stat.st_mode) != FileType::Socket {
        return Err(fault(path, "there is a file of this name that is no socket".to_owned()));
    }
    match connect(&new_socket()?, address) {
        Err(Errno::CONNREFUSED) => rustix::fs::unlink(path).map_err(|error| fault(path, error.to_string())),
        _ => Err(fault(path, "another engine serves there; choose another path".to_owned())),
    }
}
