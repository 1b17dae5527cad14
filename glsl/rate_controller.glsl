// The rate controller: once `cap_events` have been served in a period, it drops the services of its rest. Needs
// bus_fates.glsl.

// Events of the chunk's services up to each event's, and of those that waited before.
shared uint served[gl_WorkGroupSize.x];

int64_t period_at(int64_t left_ps) {
    const uint64_t since_ns = uint64_t(left_ps / 1000l) + readout.period_to_start_ns;
    return readout.first_period + int64_t(since_ns / readout.cap_period_ns);
}

// Events served, from the first service of this chunk on, before the first of a period; below 0 if the period has begun
// before. `waited`: services that waited before the chunk and have their turn.
int64_t served_before_period(int64_t period, uint waited) {
    uint low = 0u;
    uint high = gl_WorkGroupSize.x;
    while (low < high) {
        const uint middle = (low + high) / 2u;
        if (period_at(ends[middle]) >= period) {
            high = middle;
        } else {
            low = middle + 1u;
        }
    }
    if (low > 0u) {
        return int64_t(served[low - 1u]);
    }
    low = 0u;
    high = waited;
    while (low < high) {
        const uint middle = (low + high) / 2u;
        if (period_at(bus[at_row(ROW_END, middle)]) >= period) {
            high = middle;
        } else {
            low = middle + 1u;
        }
    }
    loops += 32u;
    if (low > 0u) {
        return bus[at_row(ROW_SERVED, low - 1u)];
    }
    return bus[at_head(HEAD_PERIOD)] == period ? -bus[at_head(HEAD_SERVED)] : 0l;
}

// Whether a service that ends at `end_ps`, with `before` events served before it, is dropped.
bool is_capped(int64_t end_ps, uint before, uint waited) {
    return readout.cap_events != 0u
        && int64_t(before) - served_before_period(period_at(end_ps), waited) >= int64_t(readout.cap_events);
}
