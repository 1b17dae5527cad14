// A subgroup-aggregated atomic: one atomic operation for all active threads of a subgroup, for counters that many
// threads increment.

#extension GL_KHR_shader_subgroup_arithmetic : require

// previous = what `atomicAdd(counter, 1u)` would return.
#define INCREMENT(counter, previous) \
    { \
        const uint here = subgroupAdd(1u); \
        const uint ahead = subgroupExclusiveAdd(1u); \
        uint base = 0u; \
        if (ahead == 0u) { \
            base = atomicAdd(counter, here); \
        } \
        previous = subgroupAdd(base) + ahead; \
    }
