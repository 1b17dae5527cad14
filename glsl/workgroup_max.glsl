// The largest of a number of each thread of a workgroup.
#extension GL_KHR_shader_subgroup_arithmetic : require

// A subgroup has at least four threads.
shared int64_t subgroup_largest[gl_WorkGroupSize.x / 4u];

// Called by the whole workgroup; ends with a barrier.
int64_t workgroup_max(int64_t own) {
    // As two halves: devices need not reduce 64 bits.
    const int high = int(own >> 32);
    const int highest = subgroupMax(high);
    const uint low = subgroupMax(high == highest ? uint(own) : 0u);
    barrier();
    if (subgroupElect()) {
        subgroup_largest[gl_SubgroupID] = (int64_t(highest) << 32) | int64_t(low);
    }
    barrier();
    int64_t largest = subgroup_largest[0];
    for (uint i = 1u; i < gl_NumSubgroups; ++i) {
        largest = max(largest, subgroup_largest[i]);
    }
    return largest;
}
