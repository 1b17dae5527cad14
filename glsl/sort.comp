// sort: sorts the events of each bin by (t, y, x, polarity) and writes them as struct of arrays, into memory that the
// host reads. Equal events are equal in every bit, so the packet does not depend on the order in which they came.
//
// One workgroup per group of GROUP_BINS bins; x over groups, y over cameras. Each workgroup sums all bins itself, to
// know where its own begin: they are few, and a dispatch for that would cost more. In a rig with many, `bin_sums` has summed
// them in chunks (SUMMED). Events are ranked within their bins
// in shared memory: a group or half of it at once if they fit, else bin by bin. Stores are line-aligned: partial PCIe
// writes are slow. Where a bin overflowed, the workgroup searches the overflow buffer for its events.
//
// If a bin has more than SORTABLE_EVENTS, or the overflow buffer more than SEARCHED_EVENTS, the packet is heavy: its
// events go to `gathered` only, bin by bin, and `merge` adds those of the overflow. If only the overflow was too long,
// `sort` then runs again (push.merged) and finds all events there; else `merge` sorts them too.
//
// Deferred events go to `gathered` as well, behind the packet, where the next tick's `deferred` finds them. So do events
// with a bus before them, sorted, for `readout`; what leaves the bus comes back as the packet of the camera's outlet.
// Where events hardly wait for the bus, they are served here (sort_served.glsl), and the packet of the outlet is written
// at once. The first workgroup writes the camera's `report` for the host and resets the next tick's counters; all
// workgroups clear the next tick's bins.
#version 460
#extension GL_GOOGLE_include_directive : require
#extension GL_KHR_shader_subgroup_arithmetic : require
#include "common.glsl"
#include "sort_constants.glsl"
#include "subgroup_atomic.glsl"

layout(local_size_x = SORT_THREADS, local_size_x_id = THREADS_ID) in;

BUFFER(, SLOT_COUNTERS, Counters, counters);
BUFFER(, SLOT_BINS, uint, bins);
BUFFER(readonly, SLOT_BIN_STORAGE, uvec2, bin_storage);
BUFFER(readonly, SLOT_OVERFLOW, uvec2, overflow);
BUFFER(, SLOT_GATHERED, uvec2, gathered);
BUFFER(writeonly, SLOT_EVENT_T, uint, event_t);
BUFFER(writeonly, SLOT_EVENT_X, uint16_t, event_x);
BUFFER(writeonly, SLOT_EVENT_Y, uint16_t, event_y);
BUFFER(writeonly, SLOT_EVENT_P, uint8_t, event_p);
BUFFER(writeonly, SLOT_REPORT, Counters, report);
BUFFER(, SLOT_BUS, int64_t, bus);

#include "readouts.glsl"

const bool MAY_BIN_BY_SAMPLE = true;

// Whether events go to `readout`, which finds them in `gathered`, and not into the packet.
bool before_bus;

Readout readout;

#include "udiv_float.glsl"

uint fast_udiv(uint x, uint divisor) {
    return NATIVE_DIVISION ? x / divisor : float_udiv(x, divisor);
}

#include "bins.glsl"
#include "event_order.glsl"
#include "bus_layout.glsl"
#include "merge_passes.glsl"

// Most events of a group that is ranked at once: the other half of `keys` receives them in order. Ranking takes as many
// steps as a bin has events; beyond RANKED_BIN_EVENTS it takes fewer steps to split bins first.
const uint RANKED_EVENTS = SORTABLE_EVENTS / 2u;
const uint RANKED_BIN_EVENTS = 64u;

// A group's events, or a part of them.
shared uvec2 keys[SORTABLE_EVENTS];

#include "bitonic_sort.glsl"
#include "split_sort.glsl"

// For each bin of the group: its events, where they begin, and how many overflow events were found.
shared uint counts[GROUP_BINS];
shared uint offsets[GROUP_BINS];
shared uint found[GROUP_BINS];

// Events before the group, events in all, the largest bin.
shared uint sum_ahead;
shared uint sum_packet;
shared uint sum_largest;

struct Sums {
    uint ahead;
    uint packet;
    uint largest_bin;
};

// First element in `gathered` of the group's events, if all of the packet lie there.
uint gathered_first;
const uint NOT_GATHERED = 0xffffffffu;

bool is_heavy(Sums all, uint overflow_count) {
    return all.largest_bin > SORTABLE_EVENTS || overflow_count > SEARCHED_EVENTS;
}

// Sums over the camera's bins. Called by the whole workgroup; ends with a barrier.
Sums sum_bins(Camera cam, uint first_bin) {
    const uint own = bins_of(cam, cam.frame_slot);
    uvec3 sum = uvec3(0u);
    if (SUMMED) {
        const uint chunk = first_bin / SUMMED_BINS;
        for (uint c = gl_LocalInvocationID.x; c < chunks_of(cam); c += gl_WorkGroupSize.x) {
            const uint count = bins[sums_of(cam) + 2u * c];
            sum = uvec3(sum.x + (c < chunk ? count : 0u), sum.y + count, max(sum.z, bins[sums_of(cam) + 2u * c + 1u]));
        }
        for (uint b = chunk * SUMMED_BINS + gl_LocalInvocationID.x; b < first_bin; b += gl_WorkGroupSize.x) {
            sum.x += bins[own + b];
        }
    } else {
        for (uint b = gl_LocalInvocationID.x; b < cam.bin_count; b += gl_WorkGroupSize.x) {
            const uint count = bins[own + b];
            sum = uvec3(sum.x + (b < first_bin ? count : 0u), sum.y + count, max(sum.z, count));
        }
    }
    const uvec3 subgroup_sum = uvec3(subgroupAdd(sum.xy), subgroupMax(sum.z));
    if (subgroupElect()) {
        atomicAdd(sum_ahead, subgroup_sum.x);
        atomicAdd(sum_packet, subgroup_sum.y);
        atomicMax(sum_largest, subgroup_sum.z);
    }
    barrier();
    return Sums(sum_ahead, sum_packet, sum_largest);
}

void write_report(Camera cam, Counters counted, Sums sums_of_bins, uint deferred, bool fitted) {
    const uint counter = 2u * cam.slot + cam.frame_slot;
    counted.packet = sums_of_bins.packet;
    counted.deferred = deferred;
    counted.largest_bin = sums_of_bins.largest_bin;
    counted.heavy = uint(is_heavy(sums_of_bins, counted.overflow));
    report[cam.slot] = counted;
    if (fitted) {
        counters[counter].packet = counted.packet;
        counters[counter].deferred = counted.deferred;
        counters[counter].largest_bin = counted.largest_bin;
        counters[counter].heavy = counted.heavy;
        counters[2u * cam.slot + 1u - cam.frame_slot] =
            Counters(0u, 0xffffffffu, 0u, 0u, 0u, 0u, 0u, 0u, 0u, 0u, 0u, 0u, 0u, 0u, 0u, 0u, 0u, 0u, 0u, 0u, 0u,
                     0u, 0u, 0u, 0u, 0u, 0u, 0u, 0u, 0u);
    }
}

// Bin in the group, and position in it, of an overflow event that belongs to bins [first, last) of the group; bin
// `last` for all other events.
uvec2 place_of_overflow(Camera cam, uvec2 event, uint first_bin, uint first, uint last) {
    const uint bin = (event.y & DEFERRED) == 0u ? bin_of(cam, event.x, event.y >> 1) - first_bin : last;
    return bin >= first && bin < last ? uvec2(bin, cam.bin_capacity + atomicAdd(found[bin], 1u)) : uvec2(last, 0u);
}

// Which of bins [first, last) of the group holds their event number `e`: the last bin that begins at or before it.
uint bin_with(uint e, uint first, uint last) {
    uint bin = first;
    for (uint further = GROUP_BINS / 2u; further > 0u; further /= 2u) {
        bin += bin + further < last && offsets[bin + further] - offsets[first] <= e ? further : 0u;
    }
    return bin;
}

// How many of keys [first, last) come before key `e`, which is one of them; equal keys keep their order.
uint rank_among(uint e, uint first, uint last) {
    const uvec2 key = keys[e];
    uint rank = 0u;
    for (uint other = first; other < last; ++other) {
        rank += uint(before(keys[other], key) || (keys[other] == key && other < e));
    }
    return rank;
}

// Writes keys as events [first, first + length) of the packet; a subgroup writes whole lines. `split`: the keys in the
// order that `split_sort` has found, else keys [from, from + length).
void write_keys(Camera cam, uint first, uint length, uint from, bool split) {
    const uint line = first & ~31u;
    for (uint position = line + gl_LocalInvocationID.x; position < first + length; position += gl_WorkGroupSize.x) {
        if (position >= first) {
            const uint e = position - first;
            const uvec2 key = keys[split ? uint(in_order[e]) : from + e];
            if (HAS_BUS && before_bus) {
                gathered[position] = key;
            } else {
                write_out(cam, position, key);
            }
        }
    }
}

// Largest of bins [first, last) of the group.
uint largest_of(uint first, uint last) {
    uint largest = 0u;
    for (uint b = first; b < last; ++b) {
        largest = max(largest, counts[b]);
    }
    return largest;
}

// Loads the events of bins [first, last) of the group, which fit shared memory; the largest bin has `largest`. Ends
// with a barrier.
void load_bins(Camera cam, uint first_bin, uint first, uint last, uint largest, uint overflow_count) {
    const uint lane = gl_LocalInvocationID.x;
    const uint start = offsets[first];
    const uint length = offsets[last - 1u] + counts[last - 1u] - start;
    for (uint e = lane; e < length; e += gl_WorkGroupSize.x) {
        if (gathered_first != NOT_GATHERED) {
            keys[e] = gathered[gathered_first + start + e];
            continue;
        }
        const uint bin = bin_with(e, first, last);
        const uint in_bin = e - (offsets[bin] - start);
        if (in_bin < cam.bin_capacity) {
            keys[e] = bin_storage[cam.bin_storage_base + (first_bin + bin) * cam.bin_capacity + in_bin];
        }
    }
    if (gathered_first == NOT_GATHERED && largest > cam.bin_capacity) {
        for (uint i = lane; i < overflow_count; i += gl_WorkGroupSize.x) {
            const uvec2 event = overflow[cam.event_base + i];
            const uvec2 place = place_of_overflow(cam, event, first_bin, first, last);
            if (place.x < last) {
                keys[offsets[place.x] - start + place.y] = event;
            }
        }
    }
    barrier();
}

// Sorts the group's `length` events, which begin at `position` of the packet, by ranks within their bins.
void rank_group(Camera cam, uint first_bin, uint length, uint largest, uint overflow_count, uint position) {
    load_bins(cam, first_bin, 0u, GROUP_BINS, largest, overflow_count);
    for (uint e = gl_LocalInvocationID.x; e < length; e += gl_WorkGroupSize.x) {
        const uint bin = bin_with(e, 0u, GROUP_BINS);
        keys[RANKED_EVENTS + offsets[bin] + rank_among(e, offsets[bin], offsets[bin] + counts[bin])] = keys[e];
    }
    barrier();
    write_keys(cam, position, length, RANKED_EVENTS, false);
}

// Sorts the group's events, as many bins at once as fit shared memory.
void split_group(Camera cam, uint first_bin, uint overflow_count, uint position) {
    uint first = 0u;
    while (first < GROUP_BINS) {
        uint last = first + 1u;
        // Bins of one time each are split by pixels, and so one at a time.
        while (cam.bin_rows == 1u && last < GROUP_BINS
            && offsets[last] + counts[last] - offsets[first] <= SORTABLE_EVENTS) {
            last += 1u;
        }
        const uint length = offsets[last - 1u] + counts[last - 1u] - offsets[first];
        load_bins(cam, first_bin, first, last, largest_of(first, last), overflow_count);
        const bool split = split_sort(length);
        if (!split) {
            bitonic_sort(length);
        }
        write_keys(cam, position + offsets[first], length, 0u, split);
        barrier();
        first = last;
    }
}

// Moves the group's events, the packet's from number `first` on, to `gathered`, bin by bin. `merge` adds those of the
// overflow and sorts.
void gather_bins(Camera cam, uint first_bin, uint first) {
    const uint lane = gl_LocalInvocationID.x;
    if (lane < GROUP_BINS && first_bin + lane < cam.bin_count) {
        bins[room_of(cam) + first_bin + lane] = first + offsets[lane] + min(counts[lane], cam.bin_capacity);
    }
    for (uint i = lane; i < GROUP_BINS * cam.bin_capacity; i += gl_WorkGroupSize.x) {
        const uint bin = i / cam.bin_capacity;
        const uint e = i - bin * cam.bin_capacity;
        if (e < counts[bin]) {
            gathered[cam.event_base + first + offsets[bin] + e] =
                bin_storage[cam.bin_storage_base + first_bin * cam.bin_capacity + i];
        }
    }
}

// Moves the workgroup's share of the deferred events to `gathered`, behind the packet.
void gather_deferred(Camera cam, uint overflow_count, uint packet) {
    const uint counter = 2u * cam.slot + cam.frame_slot;
    const uint groups = cam.bin_count / GROUP_BINS + 1u;
    const uint stride = groups * gl_WorkGroupSize.x;
    for (uint i = gl_WorkGroupID.x * gl_WorkGroupSize.x + gl_LocalInvocationID.x; i < overflow_count; i += stride) {
        const uvec2 event = overflow[cam.event_base + i];
        if ((event.y & DEFERRED) != 0u) {
            uint place;
            INCREMENT(counters[counter].gathered_deferred, place)
            gathered[cam.event_base + packet + place] = event;
        }
    }
}

#include "sort_served.glsl"

void main() {
    const uint index = push.first_camera + gl_WorkGroupID.y;
    const uint first_bin = gl_WorkGroupID.x * GROUP_BINS;
    if (cameras[index].frame_kind == FRAME_NONE || first_bin > cameras[index].bin_count) {
        return;
    }
    const Camera cam = cameras[index];
    const uint lane = gl_LocalInvocationID.x;
    const uint own = bins_of(cam, cam.frame_slot);
    const Counters counted = counters[2u * cam.slot + cam.frame_slot];
    const bool fitted = counted.emitted_fit == 0xffffffffu && (counted.queue_overflows | counted.without_levels) == 0u
        && (!HAS_BUS || counted.progress != READOUT_UNDONE);
    const bool again = push.merged != 0u;
    if (again && (counted.heavy == 0u || merge_sorts(counted))) {
        return;
    }
    before_bus = HAS_BUS && push.outlets == 0u && readouts[cam.slot].has_bus != 0u;
    if (lane < GROUP_BINS) {
        const uint bin = first_bin + lane;
        counts[lane] = bin < cam.bin_count ? bins[own + bin] : 0u;
        found[lane] = 0u;
        if (bin <= cam.bin_count) {
            bins[bins_of(cam, 1u - cam.frame_slot) + bin] = 0u;
        }
    }
    if (lane == 0u) {
        sum_ahead = 0u;
        sum_packet = 0u;
        sum_largest = 0u;
    }
    barrier();
    const uint deferred = bins[own + cam.bin_count];
    const Sums all = sum_bins(cam, first_bin);
    if (lane < GROUP_BINS) {
        uint offset = 0u;
        for (uint b = 0u; b < lane; ++b) {
            offset += counts[b];
        }
        offsets[lane] = offset;
    }
    barrier();
    if (gl_WorkGroupID.x == 0u && lane == 0u) {
        write_report(cam, counted, all, deferred, fitted);
    }
    const bool is_served = HAS_BUS && READOUT_LIGHT && before_bus && !again;
    if (HAS_BUS && READOUT_LIGHT) {
        readout = readouts[cam.slot];
    }
    const Camera outlet = cameras[is_served ? readout.outlet_row : index];
    if (is_served && fitted) {
        prepare_outlet(outlet, first_bin);
    }
    if (!fitted || cam.frame_kind != FRAME_INTERVAL) {
        // Not all events fit (the host grows the buffers and `cross` runs again), `readout` has to go on, or there is no
        // interval.
        return;
    }
    const bool heavy = is_heavy(all, counted.overflow) && !again;
    if (is_served) {
        take_places(outlet);
    }
    if (deferred != 0u && !again) {
        gather_deferred(cam, counted.overflow, all.packet);
    }
    const uint events = offsets[GROUP_BINS - 1u] + counts[GROUP_BINS - 1u];
    if (is_served && heavy && gl_WorkGroupID.x == 0u && lane == 0u) {
        report[outlet.slot].progress = READOUT_UNDONE;
    }
    if (is_served && !heavy && (events != 0u || (all.packet == 0u && gl_WorkGroupID.x == 0u))) {
        if (serve_group(cam, outlet, first_bin, all)) {
            return;
        }
        if (lane == 0u) {
            report[outlet.slot].progress = READOUT_UNDONE;
        }
    }
    if (events == 0u) {
        return;
    }
    if (heavy) {
        gather_bins(cam, first_bin, all.ahead);
        return;
    }
    const uint position = cam.event_base + all.ahead;
    gathered_first = again ? position : NOT_GATHERED;
    const uint largest = largest_of(0u, GROUP_BINS);
    if (events <= RANKED_EVENTS && largest <= RANKED_BIN_EVENTS) {
        rank_group(cam, first_bin, events, largest, counted.overflow, position);
    } else {
        split_group(cam, first_bin, counted.overflow, position);
    }
}
