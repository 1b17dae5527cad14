//! Frames from other processes: a renderer writes into memory that the engine reads in place.
//!
//! A [`Server`] listens on a Unix socket, with one connection for each camera. It shares a [`Ring`] of buffers
//! with each producer, receives frames and gives slots back. A [`Service`] steps a rig with these frames. A
//! [`Producer`] is the other side of the link.
//!
//! [`wire`] defines the messages; the `README.md` of this crate explains them to authors of producers.
//! [`session`] decides which messages the engine accepts, without sockets or devices. [`Support`] asks the
//! drivers what two devices can share before anything is made.

mod client;
pub mod cuda;
mod error;
mod frame_scene;
mod host_memory;
mod image;
mod images;
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
mod stand_in;
mod support;
mod timeline;
mod trial;
pub mod wire;

pub use client::{Client, Copies, Gives};
pub use error::InteropError;
pub use frame_scene::FrameScene;
pub use images::{Images, Planes};
pub use producer::{Producer, ProducerOptions};
pub use ring::{Ring, Slot};
pub use server::{
    CameraTerms, ConnectionCounts, DEFAULT_INSTANCES, DEFAULT_SLOTS, LinkCounts, Outcome, Ready, Server,
    ServerOptions,
};
pub use service::{InputWarnings, Service, ServiceTick};
pub use support::Support;
pub use timeline::{CarriedTimeline, ExportedTimeline, SharedTimeline};
