//! Tests of one pixel or a few against closed forms.

mod faults;
mod invariants;
mod light;
mod noise;
mod timing;
