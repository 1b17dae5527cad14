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

// As `atomicMin(least[slot], value)`, by all active threads of a subgroup, whose slots mostly are the same.
#define TELL_LEAST(least, slot, value) \
    { \
        const uint shared_slot = subgroupMin(slot); \
        if (shared_slot == subgroupMax(slot)) { \
            const uint least_value = subgroupMin(value); \
            if (subgroupElect()) { \
                atomicMin(least[slot], least_value); \
            } \
        } else { \
            atomicMin(least[slot], value); \
        } \
    }
