//! Analytic scenes in two implementations: closed-form radiance in f64 ([`Scene`], [`View`], [`exact_events`],
//! [`render_cpu`]) and a Vulkan renderer of the same functions ([`Renderer`]).
//!
//! Radiance is band-limited. Texture fades before it aliases. Every border is a smooth blend over about two pixels,
//! which is part of the scene's definition. Motion, depth and instance id are those of the nearest surface that covers at
//! least half of a pixel. Previous position = position + motion, pixels, y down. Depth is in metres along the view axis,
//! infinite for hills and sky. Instance 0 is what stands still in the world. Pixel centres are at whole numbers.

pub mod camera;
pub mod cards;
pub mod closed_form;
pub mod cut;
pub mod exact;
mod flight;
pub mod frame;
mod jet;
pub mod layout;
pub mod object;
mod order;
mod poses;
pub mod registry;
pub mod renderer;
pub mod scene;
pub mod texture;
pub mod view;
mod wall;

pub use camera::{CameraPath, CameraState, ImuSample};
pub use exact::{all_pixels, exact_events, log_intensity};
pub use frame::{Frame, render_cpu};
pub use registry::{SceneKind, UnknownScene};
pub use renderer::{RenderError, Renderer, Targets};
pub use scene::Scene;
pub use view::{PixelSample, View};
