//! Frames from other processes: a renderer writes into memory that the engine reads where it lies.
//!
//! A [`Server`] listens on a Unix socket, one connection a camera. It shares a [`Ring`] of buffers with
//! each producer, hands over what arrives and gives slots back; a [`Service`] steps a rig with that. A
//! [`Producer`] is the other side. What both say is in [`wire`], for authors of producers in `README.md`
//! of this crate; what the engine's side accepts is [`session`], without sockets or devices.
//!
//! Which memory and which timelines two devices can share is asked of the drivers ([`Support`]) before
//! anything is made.

mod client;
pub mod cuda;
mod error;
mod host_memory;
mod image;
mod lent;
mod memory;
mod ownership;
mod plane;
mod producer;
mod ring;
mod server;
mod service;
pub mod session;
mod socket;
mod support;
mod timeline;
pub mod wire;

pub use client::{Client, Copies};
pub use error::InteropError;
pub use producer::{Producer, ProducerOptions};
pub use ring::{Images, Ring, Slot};
pub use server::{CameraTerms, LinkCounts, Outcome, Ready, Server, ServerOptions};
pub use service::{Service, ServiceTick};
pub use support::Support;
pub use timeline::{CarriedTimeline, ExportedTimeline, SharedTimeline};
