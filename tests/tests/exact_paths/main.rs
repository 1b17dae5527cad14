//! Synthesis `rigid` of the engine: stages, levels and events against the oracle, and what it refuses.
//!
//! The test script lets the validation layer watch the calls alone: the software driver takes minutes to compile one of
//! these kernels with what the layer writes into it.

mod rigid;
