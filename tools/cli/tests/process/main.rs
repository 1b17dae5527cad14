//! Tests at the boundary of the process: the binary is run as a user runs it.

mod bad_input;
mod bench;
mod compare;
mod demo;
mod glsl;
mod harness;
mod link;
mod listings;
mod poses;
mod render;
mod ros;
mod simulate;
mod synthesis;
mod usage;
