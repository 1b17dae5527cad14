//! Noise events of the physical pixel against sampled paths of the noise itself, and against their closed forms.

mod case;
mod hazard;
mod path;
mod presets;
mod renewal;
