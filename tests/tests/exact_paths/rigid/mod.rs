//! Suites of synthesis `rigid`.

mod doubt;
mod event_ids;
mod input;
mod levels;
mod passes;
mod plane;
mod poses;
mod stages;
mod still;
mod swept;
mod truth;
mod unoccluded;
