// Services on a bus: those that wait from chunk to chunk, and those of a chunk's events. Needs bus_scan.glsl, `bus`,
// `readout`, `cam` and `free_ps`. The services that wait are numbered in the order in which they will be. What the arrays
// ROW_OPENER to ROW_SERVED hold, `BUS_ROWS` in the crate esaac-layout says.

#include "bus_layout.glsl"

// What the bus tells of a pixel whose event waits: that it is OFF, or ON.
const int64_t WAITS = 0x7ffffffffffffffel;

// An element of one of the arrays; BUS_ROW is behind the last.
uint at_row(uint array, uint index) {
    return readout.bus_base + BUS_HEAD + cam.pixels + array * cam.height + index;
}

// Events of a stretch.
const uint STRETCH = gl_WorkGroupSize.x / 2u;

// Of a stretch: when the bus is free after it at the latest, if it was idle before.
uint at_load(uint stretch) {
    return at_row(BUS_ROW, 0u) + BUS_STRETCH * stretch;
}

// Of a stretch: the first event before which the bus is idle for certain, and SERVED if all events from there on to the
// next such event are served; NOT_IDLE if there is none.
uint at_idle(uint stretch) {
    return at_load(stretch) + 1u;
}

const int64_t SERVED = 1l << 32;
const int64_t NOT_IDLE = -1l;

// Makes writes to shared memory and to `bus` visible to the workgroup.
void sync() {
    memoryBarrierBuffer();
    memoryBarrierShared();
    barrier();
}

int64_t service_ps(uint64_t events) {
    return int64_t(readout.row_ps + events * readout.event_ps);
}

shared int64_t last_end;

// Finds when the services that wait begin and end, and returns when the bus is free after them. Called by the whole
// workgroup after a sync; ends with one.
int64_t serve_waiting(uint services) {
    int64_t free = free_ps;
    for (uint first = 0u; first < services; first += gl_WorkGroupSize.x) {
        const uint service = first + gl_LocalInvocationID.x;
        int64_t duration = 0l;
        Step own = Step(0l, NEVER);
        if (service < services) {
            const int64_t joined = bus[at_row(ROW_JOINED, service)];
            duration = service_ps(uint64_t((bus[at_row(ROW_EVENTS, service)] >> 32) + joined));
            own = Step(duration, bus[at_row(ROW_OPENER, service)] * 1000l + duration);
        }
        own = scan(own);
        const int64_t end = max(free + own.sum, own.latest);
        if (service < services) {
            bus[at_row(ROW_BEGIN, service)] = end - duration;
            bus[at_row(ROW_END, service)] = end;
        }
        if (gl_LocalInvocationID.x == gl_WorkGroupSize.x - 1u) {
            last_end = end;
        }
        sync();
        free = last_end;
        sync();
        loops += 12u;
    }
    return free;
}
