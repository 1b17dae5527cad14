//! Suites of synthesis `rigid`.

mod doubt;
mod input;
mod levels;
mod plane;
mod stages;
