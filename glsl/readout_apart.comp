// readout_apart: part of `readout`. Serves, side by side, chunks of events before and after which the bus is idle for
// certain. Such a chunk depends on no other.
//
// A bus is no busier than one that serves each event, lost or not, in the time that an event of its own takes. When that
// one is idle, so is the bus, and all pixels are free. Level 0 finds how busy it is after each stretch of events. Level
// 1 finds the first event in each stretch that finds it idle, and serves the events from there on to the next such event, if
// there are no more of them than the workgroup has threads, and `readout` has nothing to keep of them. It leaves all
// others to `readout`.
//
// x over stretches, y over cameras. A rate controller counts all events of a period, so that its chunks are never served
// side by side. Nothing is done once `readout` has begun with a packet.
#version 460
#extension GL_GOOGLE_include_directive : require
#include "common.glsl"
#include "readout_constants.glsl"

const bool SIDE_BY_SIDE = true;

#include "readout.glsl"

// First events that find the bus idle: in the workgroup's stretch, and after it.
shared uint idle_first;
shared uint idle_after;

// The most that each event can add to the bus's work.
int64_t most_ps() {
    return service_ps(1ul);
}

// When the bus is free before a stretch, at the latest. Called by the whole workgroup; ends with a barrier.
int64_t load_before(uint stretch) {
    const int64_t of_stretch = int64_t(STRETCH) * most_ps();
    int64_t latest = NEVER;
    for (uint i = gl_LocalInvocationID.x; i < stretch; i += gl_WorkGroupSize.x) {
        latest = max(latest, bus[at_load(i)] + int64_t(stretch - 1u - i) * of_stretch);
    }
    latest = scan(Step(0l, latest)).latest;
    if (gl_LocalInvocationID.x == gl_WorkGroupSize.x - 1u) {
        last_end = latest;
    }
    barrier();
    const int64_t waiting_ps = bus[at_head(HEAD_SERVICES)] * int64_t(readout.row_ps)
        + bus[at_head(HEAD_WAITING)] * int64_t(readout.event_ps);
    const int64_t from_start = bus[at_free(cam.frame_slot)] + waiting_ps + int64_t(stretch) * of_stretch;
    latest = max(last_end, from_start);
    barrier();
    return latest;
}

void find_load(Camera source, Counters counted, uint stretch) {
    const uint lane = gl_LocalInvocationID.x;
    const uint e = stretch * STRETCH + lane;
    Step own = Step(0l, NEVER);
    if (lane < STRETCH && e < counted.packet) {
        const uint now_ns = read_event(lies_in_gathered(counted), source.event_base + e).x;
        own = Step(most_ps(), int64_t(now_ns) * 1000l + most_ps());
    }
    own = scan(own);
    if (lane == gl_WorkGroupSize.x - 1u) {
        bus[at_load(stretch)] = own.latest;
    }
    barrier();
}

void serve_apart(Camera source, Counters counted, uint stretch) {
    const uint lane = gl_LocalInvocationID.x;
    const uint begin = stretch * STRETCH;
    const bool in_gathered = lies_in_gathered(counted);
    const int64_t before_ps = load_before(stretch);
    const uint length = min(counted.packet - begin, gl_WorkGroupSize.x);
    int64_t now_ps = 0l;
    Step own = Step(0l, NEVER);
    if (lane < length) {
        now_ps = int64_t(read_event(in_gathered, source.event_base + begin + lane).x) * 1000l;
        own = Step(most_ps(), now_ps + most_ps());
    }
    own = scan(own);
    const int64_t end_ps = max(before_ps + own.sum, own.latest);
    ends[lane] = end_ps;
    idle_first = NONE;
    idle_after = NONE;
    count_lost = 0u;
    barrier();
    const bool is_idle = lane < length && (lane == 0u ? before_ps : ends[lane - 1u]) < now_ps;
    if (is_idle && lane < STRETCH) {
        atomicMin(idle_first, lane);
    }
    if (is_idle && lane >= STRETCH) {
        atomicMin(idle_after, lane);
    }
    // Nothing is left of the last events if the bus has served them when the interval ends.
    if (lane + 1u == length && begin + length == counted.packet && end_ps <= int64_t(cam.interval_ns) * 1000l) {
        atomicMin(idle_after, length);
    }
    barrier();
    const uint from = idle_first;
    const uint to = idle_after;
    if (lane == 0u) {
        const bool is_served = from != NONE && to != NONE;
        bus[at_idle(stretch)] = from == NONE ? NOT_IDLE : int64_t(begin + from) | (is_served ? SERVED : 0l);
    }
    barrier();
    if (from == NONE || to == NONE) {
        return;
    }
    const bool is_event = lane < to - from;
    const uvec2 event = is_event ? read_event(in_gathered, source.event_base + begin + from + lane) : uvec2(0u);
    free_ps = 0l;
    const int64_t since_epoch_ns = source.start_ns - source.epoch_ns;
    serve_chunk(event, is_event, 0u, since_epoch_ns, true, 0u);
    if (lane == 0u && count_lost != 0u) {
        atomicAdd(counters[2u * cam.slot + cam.frame_slot].lost, count_lost);
    }
}

void main() {
    const Camera source = cameras[push.first_camera + gl_WorkGroupID.y];
    if (source.frame_kind != FRAME_INTERVAL || readouts[source.slot].has_bus == 0u) {
        return;
    }
    readout = readouts[source.slot];
    cam = cameras[readout.outlet_row];
    loops = 0u;
    const Counters counted = counters[2u * source.slot + source.frame_slot];
    if (!is_ready(counted) || readout.cap_events != 0u || bus[at_head(HEAD_NEXT)] != 0l
        || counters[2u * cam.slot + cam.frame_slot].progress == READOUT_DONE) {
        return;
    }
    const uint stretches = (counted.packet + STRETCH - 1u) / STRETCH;
    for (uint stretch = gl_WorkGroupID.x; stretch < stretches; stretch += gl_NumWorkGroups.x) {
        if (push.level == 0u) {
            find_load(source, counted, stretch);
        } else {
            serve_apart(source, counted, stretch);
        }
        sync();
    }
}
