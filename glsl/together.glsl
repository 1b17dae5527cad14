// Counting by subgroups: one atomic operation for all of a subgroup's threads that are there, where many threads
// count on one word.

#extension GL_KHR_shader_subgroup_arithmetic : require

// place = what `atomicAdd(counter, 1u)` would return.
#define COUNT_TOGETHER(counter, place) \
    { \
        const uint here = subgroupAdd(1u); \
        const uint ahead = subgroupExclusiveAdd(1u); \
        uint base = 0u; \
        if (ahead == 0u) { \
            base = atomicAdd(counter, here); \
        } \
        place = subgroupAdd(base) + ahead; \
    }
