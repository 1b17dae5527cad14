//! A peer of the interop socket that sends whatever a test wants, well formed or not.

use crate::device::DEVICE;
use esaac_interop::wire::{
    Hello, MAX_BYTES, MAX_FDS, MEMORY_BROUGHT, MEMORY_EXPORTED, Message, Refusal, TIMELINE_CARRIED, Version,
};
use rustix::event::{PollFd, PollFlags, Timespec, poll};
use rustix::fd::{BorrowedFd, OwnedFd};
use rustix::net::{
    AddressFamily, RecvAncillaryBuffer, RecvAncillaryMessage, RecvFlags, SendAncillaryBuffer,
    SendAncillaryMessage, SendFlags, SocketAddrUnix, SocketFlags, SocketType, connect, recvmsg, sendmsg,
    socket_with,
};
use std::io::{IoSlice, IoSliceMut};
use std::mem::MaybeUninit;
use std::path::Path;

/// A connection that enforces no protocol.
pub struct Peer {
    fd: OwnedFd,
    version: Version,
}

/// A greeting as a producer on the device under test sends it.
#[must_use]
pub fn greeting() -> Hello {
    Hello {
        device_uuid: DEVICE.info().uuid,
        driver_uuid: DEVICE.info().driver_uuid,
        memories: MEMORY_EXPORTED,
        timelines: TIMELINE_CARRIED,
        ..Hello::default()
    }
}

/// A greeting as from [`greeting`], of a producer that brings its own memory.
#[must_use]
pub fn bringing() -> Hello {
    Hello { memories: MEMORY_BROUGHT, ..greeting() }
}

/// A socket that producers connect to.
#[must_use]
pub fn listen(path: &Path) -> OwnedFd {
    let Peer { fd, .. } = Peer::unconnected();
    rustix::net::bind(&fd, &SocketAddrUnix::new(path).unwrap()).expect("a new socket");
    rustix::net::listen(&fd, 4).expect("a socket that listens");
    fd
}

impl Peer {
    /// Connects.
    #[must_use]
    pub fn connect(path: &Path) -> Self {
        let peer = Peer::unconnected();
        peer.connect_to(path);
        peer
    }

    /// Opens the socket without connecting it.
    #[must_use]
    pub fn unconnected() -> Self {
        let fd = socket_with(AddressFamily::UNIX, SocketType::SEQPACKET, SocketFlags::CLOEXEC, None).unwrap();
        Peer { fd, version: Version::NEWEST }
    }

    /// The same peer, which speaks another version.
    #[must_use]
    pub fn speaking(self, version: Version) -> Self {
        Peer { version, ..self }
    }

    /// The next producer that connects to a socket of [`listen`]: this side is the engine.
    #[must_use]
    pub fn accept(listener: &OwnedFd) -> Self {
        let fd = rustix::net::accept(listener).expect("a producer connects");
        Peer { fd, version: Version::NEWEST }
    }

    /// Connects a socket from [`Peer::unconnected`].
    pub fn connect_to(&self, path: &Path) {
        connect(&self.fd, &SocketAddrUnix::new(path).unwrap()).expect("the engine listens");
    }

    /// Sends bytes as they are.
    pub fn send_bytes(&self, bytes: &[u8], fds: &[BorrowedFd<'_>]) {
        let mut space = [MaybeUninit::uninit(); rustix::cmsg_space!(ScmRights(2 * MAX_FDS))];
        let mut control = SendAncillaryBuffer::new(&mut space);
        assert!(fds.is_empty() || control.push(SendAncillaryMessage::ScmRights(fds)));
        // The result does not matter: if the engine has closed the connection, it has sent its answer before.
        let _ = sendmsg(&self.fd, &[IoSlice::new(bytes)], &mut control, SendFlags::NOSIGNAL);
    }

    /// Sends a message.
    pub fn send(&self, message: Message, fds: &[BorrowedFd<'_>]) {
        self.send_bytes(&message.to_bytes(self.version, fds.len()), fds);
    }

    /// The next message and its descriptors; `None` once the connection is closed. The engine answers
    /// within ten seconds.
    #[must_use]
    pub fn receive(&self) -> Option<(Message, Vec<OwnedFd>)> {
        let (bytes, fds) = self.receive_bytes()?;
        let message = Message::parse(self.version, &bytes, fds.len());
        Some((message.expect("the engine speaks well"), fds))
    }

    /// As [`Peer::receive`], the message as it came.
    #[must_use]
    pub fn receive_bytes(&self) -> Option<(Vec<u8>, Vec<OwnedFd>)> {
        let limit = Timespec { tv_sec: 10, tv_nsec: 0 };
        let ready = poll(&mut [PollFd::new(&self.fd, PollFlags::IN)], Some(&limit)).unwrap();
        assert_eq!(ready, 1, "no answer in ten seconds");
        let mut bytes = [0; MAX_BYTES];
        let mut space = [MaybeUninit::uninit(); rustix::cmsg_space!(ScmRights(MAX_FDS))];
        let mut control = RecvAncillaryBuffer::new(&mut space);
        let mut next =
            || recvmsg(&self.fd, &mut [IoSliceMut::new(&mut bytes)], &mut control, RecvFlags::CMSG_CLOEXEC);
        // If the engine closed without reading everything, the first call returns that error and the second the last
        // message.
        let count = match next().or_else(|_| next()) {
            Ok(received) if received.bytes > 0 => received.bytes,
            _ => return None,
        };
        let fds: Vec<OwnedFd> = control
            .drain()
            .filter_map(|message| match message {
                RecvAncillaryMessage::ScmRights(fds) => Some(fds),
                _ => None,
            })
            .flatten()
            .collect();
        Some((bytes[..count].to_vec(), fds))
    }

    /// The engine's refusal, after which it closes the connection.
    #[must_use]
    pub fn refusal(&self) -> Refusal {
        let mut last = None;
        while let Some((message, _)) = self.receive() {
            last = Some(message);
        }
        match last {
            Some(Message::Refusal(refusal)) => refusal,
            other => panic!("expected a refusal, the last message is {other:?}"),
        }
    }
}
