// Bitonic sort of `keys` in shared memory. Needs event_order.glsl.

// Sorts keys [0, length); `keys` has room for the next power of two. Called by the whole workgroup after a barrier;
// ends with a barrier.
void bitonic_sort(uint length) {
    const uint lane = gl_LocalInvocationID.x;
    uint size = 2u;
    while (size < length) {
        size *= 2u;
    }
    for (uint e = length + lane; e < size; e += gl_WorkGroupSize.x) {
        keys[e] = uvec2(0xffffffffu);
    }
    barrier();
    for (uint run = 2u; run <= size; run *= 2u) {
        for (uint apart = run / 2u; apart > 0u; apart /= 2u) {
            for (uint pair = lane; pair < size / 2u; pair += gl_WorkGroupSize.x) {
                const uint low = 2u * pair - (pair & (apart - 1u));
                const uvec2 a = keys[low];
                const uvec2 b = keys[low + apart];
                const bool rises = (low & run) == 0u;
                if (rises ? before(b, a) : before(a, b)) {
                    keys[low] = b;
                    keys[low + apart] = a;
                }
            }
            barrier();
        }
    }
}
