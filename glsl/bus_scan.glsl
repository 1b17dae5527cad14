// When services on a bus end that follow one another: a prefix maximum over the threads of a workgroup. A service that
// takes `c` and is asked for at `t` turns the time at which the bus is free from `f` into `max(f + c, t + c)`. Such
// steps `f -> max(f + sum, latest)` follow one another as another one of their kind. Picoseconds from the interval's
// start.

struct Step {
    int64_t sum;
    int64_t latest;
};

// `latest` of a step that asks for no service.
const int64_t NEVER = -(1l << 62);

// Two buffers, used in turn.
shared int64_t scanned_sum[2u * gl_WorkGroupSize.x];
shared int64_t scanned_latest[2u * gl_WorkGroupSize.x];

// The steps of all threads up to this one as one. Called by the whole workgroup.
Step scan(Step own) {
    const uint lane = gl_LocalInvocationID.x;
    uint from = 0u;
    scanned_sum[lane] = own.sum;
    scanned_latest[lane] = own.latest;
    barrier();
    for (uint apart = 1u; apart < gl_WorkGroupSize.x; apart *= 2u) {
        const uint to = gl_WorkGroupSize.x - from;
        if (lane >= apart) {
            const uint ahead = from + lane - apart;
            own.latest = max(scanned_latest[ahead] + own.sum, own.latest);
            own.sum += scanned_sum[ahead];
        }
        scanned_sum[to + lane] = own.sum;
        scanned_latest[to + lane] = own.latest;
        from = to;
        barrier();
    }
    return own;
}
