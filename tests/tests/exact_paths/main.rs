//! Synthesis `rigid` of the engine: stages, levels and events against the oracle, and what it refuses.
//!
//! The test script runs these without the validation layer, and finds them by the module's name: with the layer's
//! instrumentation, the software driver takes minutes to compile one of the kernels.

mod rigid;
