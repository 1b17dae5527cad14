// A counter incremented by each thread on its own, for devices whose subgroup operations cost more than atomics.

// previous = what `atomicAdd(counter, 1u)` returns.
#define INCREMENT(counter, previous) previous = atomicAdd(counter, 1u);
