//! Suites of synthesis `rigid`.

mod input;
mod levels;
mod plane;
mod stages;
