// Serves the events of a group of bins over the sensor's bus as they are sorted, in a tick in which events hardly wait:
// none is lost, and none waits at either end of the interval to be served. Writes the outlet's packet. A workgroup that
// finds that it cannot says so in the outlet's report; the tick then goes on with `readout`, as if nothing had been
// done here.
//
// If no event is lost, an event's place in the packet differs from its place before the bus only among those of a
// cluster: those that leave in the same tick of the sensor's clock or, by row, those between two instants at which the
// bus is idle. A workgroup takes a bin on either side besides its own, so that clusters are whole. Before these bins
// the bus is free no later than it would be if the events of each bin came at the bin's end. When it is free then does
// not matter once it has been idle. Each cluster is written by the group in which it begins.

// Needs split_sort.glsl, whose shared memory it uses.

// Most events of a group and of the bins on either side: two a thread, and a quarter of `keys`. The quarters are: the
// packet; when the bus is free after each event; the events; when each leaves.
const uint QUARTER = SORTABLE_EVENTS / 4u;
const uint MOST_SERVED = 2u * gl_WorkGroupSize.x;

// By row, most events of a cluster, which one thread serves.
const uint MOST_CLUSTER = 64u;

const uint TILE_BINS = GROUP_BINS + 2u;

// Where the events of each of these bins begin; and after them all.
shared uint tile_offsets[TILE_BINS + 1u];

// Time stamp of an event that leaves after the interval.
const uint LATE = 0xffffffffu;

// What is carried over from the last tick: when it leaves, and its key.
shared uint carried_ns[MOST_CARRIED];
shared uvec2 carried_keys[MOST_CARRIED];

shared uint cluster_first;
shared uint cluster_end;
shared uint count_late;
shared bool gives_up;

const int64_t NEVER = -(1l << 62);
const uint NONE = 0xffffffffu;

// Event `e` of the tile, in order.
uvec2 tile_key(uint e) {
    return keys[2u * QUARTER + e];
}

int64_t now_ps(uint e) {
    return int64_t(tile_key(e).x) * 1000l;
}

uvec2 halves(int64_t value) {
    return uvec2(uint(value), uint(value >> 32));
}

int64_t whole(uvec2 halves) {
    return (int64_t(halves.y) << 32) | int64_t(halves.x);
}

// When the bus is free after an event; by row, at the latest.
int64_t latest_ps(uint e) {
    return whole(keys[QUARTER + e]);
}

int64_t left_ps(uint e) {
    return whole(keys[3u * QUARTER + e]);
}

void set_left(uint e, int64_t ps) {
    keys[3u * QUARTER + e] = halves(ps);
}

// Time stamps; by row, the event that has opened an event's service; how many events a service has; whether a cluster
// begins with an event.
#define STAMP(e) bucket_ends[e]
#define OPENER(e) bucket_ends[2u * QUARTER - 1u - (e)]
#define MEMBERS(e) in_order[e]
#define BEGINS(e) by_bucket[e]

// Largest of the values of all threads before this one; NEVER for the first. Called by the whole workgroup; ends with a
// barrier.
int64_t largest_before(int64_t own) {
    const uint lane = gl_LocalInvocationID.x;
    uint from = 0u;
    bucket_ends[lane] = halves(own).x;
    bucket_ends[2u * gl_WorkGroupSize.x + lane] = halves(own).y;
    barrier();
    for (uint apart = 1u; apart < gl_WorkGroupSize.x; apart *= 2u) {
        const uint to = gl_WorkGroupSize.x - from;
        if (lane >= apart) {
            const uint ahead = from + lane - apart;
            own = max(own, whole(uvec2(bucket_ends[ahead], bucket_ends[2u * gl_WorkGroupSize.x + ahead])));
        }
        bucket_ends[to + lane] = halves(own).x;
        bucket_ends[2u * gl_WorkGroupSize.x + to + lane] = halves(own).y;
        from = to;
        barrier();
    }
    const uint ahead = from + max(lane, 1u) - 1u;
    const int64_t largest = whole(uvec2(bucket_ends[ahead], bucket_ends[2u * gl_WorkGroupSize.x + ahead]));
    barrier();
    return lane == 0u ? NEVER : largest;
}

// Loads the tile's events and puts them in order into the upper half of `keys`. Ends with a barrier.
void load_tile(Camera cam, uint first_bin, uint length) {
    const uint lane = gl_LocalInvocationID.x;
    for (uint e = lane; e < length; e += gl_WorkGroupSize.x) {
        uint bin = 0u;
        while (tile_offsets[bin + 1u] <= e) {
            bin += 1u;
        }
        const uint place = (first_bin + bin - 1u) * cam.bin_capacity + e - tile_offsets[bin];
        keys[e] = bin_storage[cam.bin_storage_base + place];
    }
    barrier();
    for (uint e = lane; e < length; e += gl_WorkGroupSize.x) {
        uint bin = 0u;
        while (tile_offsets[bin + 1u] <= e) {
            bin += 1u;
        }
        const uint first = tile_offsets[bin];
        keys[2u * QUARTER + first + rank_among(e, first, tile_offsets[bin + 1u])] = keys[e];
    }
    barrier();
}

// Tells `readout`, which may have to serve the tick, whose places are taken by what `sort` has carried over from the last
// one. Where that was `readout`, it knows them.
void take_places(Camera outlet) {
    const uint last = 2u * outlet.slot + 1u - outlet.frame_slot;
    if (gl_WorkGroupID.x == 0u && gl_LocalInvocationID.x < min(counters[last].deferred, MOST_CARRIED)) {
        const uvec2 event = gathered[outlet.event_base + counters[last].packet + gl_LocalInvocationID.x];
        const int64_t left_ns = int64_t(event.x - outlet.previous_interval_ns);
        bus[at_pixel((event.y & ~DEFERRED) >> 1)] = outlet.start_ns - outlet.epoch_ns + left_ns;
    }
}

// Loads what is carried over.
void load_carried(Camera outlet, uint carried, uint place) {
    const uint lane = gl_LocalInvocationID.x;
    if (lane >= carried) {
        return;
    }
    const uvec2 event = gathered[outlet.event_base + place + lane];
    const uint left_ns = event.x - outlet.previous_interval_ns;
    const uint tag = event.y & ~DEFERRED;
    carried_ns[lane] = left_ns;
    carried_keys[lane] = uvec2(stamp_offset(outlet, left_ns), tag);
    if (left_ns > outlet.interval_ns) {
        gives_up = true;
    }
}

// Finds when the bus is free after each of the tile's events, if it is free at `free_ps` before them. Returns the first
// event after which this is certain even though the bus may be free earlier than that. Ends with a barrier.
uint find_latest(uint length, int64_t free_ps, int64_t service_ps) {
    const uint lane = gl_LocalInvocationID.x;
    int64_t own = NEVER;
    [[unroll]] for (uint i = 0u; i < 2u; ++i) {
        const uint e = 2u * lane + i;
        own = e < length ? max(own, now_ps(e) - int64_t(e) * service_ps) : own;
    }
    int64_t largest = largest_before(own);
    [[unroll]] for (uint i = 0u; i < 2u; ++i) {
        const uint e = 2u * lane + i;
        if (e < length) {
            largest = max(largest, now_ps(e) - int64_t(e) * service_ps);
            const int64_t latest = int64_t(e + 1u) * service_ps + max(largest, free_ps);
            keys[QUARTER + e] = halves(latest);
            // One by one, an event leaves when the bus is free after it.
            set_left(e, latest);
            OPENER(e) = e;
            if (largest >= free_ps) {
                atomicMin(cluster_first, e);
            }
        }
    }
    barrier();
    const uint certain = cluster_first;
    barrier();
    return certain;
}

// Whether event `e` comes while one of its pixel that was carried over is on its way.
bool is_carried_at(uint e, uint carried) {
    const uvec2 key = tile_key(e);
    for (uint i = 0u; i < carried; ++i) {
        if (carried_ns[i] >= key.x && carried_keys[i].y >> 1 == key.y >> 1) {
            return true;
        }
    }
    return false;
}

// Whether event `e` may be lost if events are served one by one. `free_ps`: when the bus is free before the tile; NEVER
// if no event comes before it.
bool may_be_lost(uint e, int64_t free_ps, uint carried) {
    const int64_t now = now_ps(e);
    uint other = e;
    while (other > 0u && latest_ps(other - 1u) >= now) {
        other -= 1u;
        if (tile_key(other).y >> 1 == tile_key(e).y >> 1) {
            return true;
        }
    }
    return (other == 0u && free_ps >= now) || is_carried_at(e, carried);
}

// Serves the cluster of events [first, last) by row, as a queue does. Returns false if an event is lost, or does not
// have its turn in the interval.
bool serve_cluster(Camera cam, uint first, uint last, int64_t free_ps, uint carried) {
    // The first service that has not begun, and the last one that has.
    uint next = first;
    uint begun = first;
    for (uint e = first; e <= last; ++e) {
        const int64_t now = e < last ? now_ps(e) : NEVER;
        while (next < e) {
            if (OPENER(next) == next) {
                const int64_t begin = max(free_ps, now_ps(next));
                if (e < last ? begin >= now : begin > int64_t(cam.interval_ns) * 1000l + 999l) {
                    break;
                }
                free_ps = begin + int64_t(readout.row_ps + uint64_t(MEMBERS(next)) * readout.event_ps);
                set_left(next, free_ps);
                begun = next;
            }
            next += 1u;
        }
        if (e == last) {
            break;
        }
        const uint pixel = tile_key(e).y >> 1;
        uint opener = e;
        // Services before the last one that has begun have ended.
        for (uint other = e; other > begun; --other) {
            const uint earlier = tile_key(other - 1u).y >> 1;
            const uint service = OPENER(other - 1u);
            const bool waits = service >= next;
            if (earlier == pixel && (waits || left_ps(service) >= now)) {
                return false;
            }
            if (waits && earlier / cam.width == pixel / cam.width) {
                opener = service;
            }
        }
        if (is_carried_at(e, carried)) {
            return false;
        }
        OPENER(e) = opener;
        MEMBERS(e) = uint16_t(0);
        MEMBERS(opener) += uint16_t(1);
    }
    if (next < last) {
        return false;
    }
    for (uint e = first; e < last; ++e) {
        set_left(e, left_ps(OPENER(e)));
    }
    return true;
}

// Ranks event `e` in its cluster, which ends before `end`, and puts it where it belongs into the lower half of `keys`.
void place_in_cluster(uint e, uint end) {
    const uvec2 key = uvec2(STAMP(e), tile_key(e).y);
    uint cluster = e;
    uint rank = 0u;
    while (BEGINS(cluster) == uint16_t(0)) {
        cluster -= 1u;
        rank += uint(!before(key, uvec2(STAMP(cluster), tile_key(cluster).y)));
    }
    for (uint other = e + 1u; other < end && BEGINS(other) == uint16_t(0); ++other) {
        rank += uint(before(uvec2(STAMP(other), tile_key(other).y), key));
    }
    keys[cluster + rank] = key;
}

// Writes what is carried over. It may leave with events of the packet's first cluster, which begins with event `first`.
void write_carried(Camera outlet, uint carried, uint first, uint end) {
    const uint lane = gl_LocalInvocationID.x;
    if (lane >= carried) {
        return;
    }
    const uvec2 key = carried_keys[lane];
    uint place = 0u;
    for (uint i = 0u; i < carried; ++i) {
        place += uint(before(carried_keys[i], key) || (carried_keys[i] == key && i < lane));
    }
    for (uint e = first; e < end && (e == first || BEGINS(e) == uint16_t(0)); ++e) {
        place += uint(before(keys[e], key));
    }
    write_out(outlet, outlet.event_base + place, key);
}

// Writes events [first, end) of the tile; the first one is event `base` of the packet, but for what is carried over. A
// subgroup writes whole lines.
void write_served(Camera outlet, uint base, uint first, uint end, uint carried) {
    const uint from = outlet.event_base + carried + base;
    for (uint at = (from & ~31u) + gl_LocalInvocationID.x; at < from + end - first; at += gl_WorkGroupSize.x) {
        const uvec2 key = at >= from ? keys[first + at - from] : uvec2(LATE);
        uint later = 0u;
        for (uint i = 0u; base == 0u && i < carried; ++i) {
            later += uint(before(key, carried_keys[i]));
        }
        if (key.x != LATE) {
            write_out(outlet, at - later, key);
        }
    }
}

// Keeps the events in [first, end) that leave after the interval, and what the next tick needs to know. Called by the
// whole workgroup. `free_ps`: when the bus is free after the packet. `carried_place`: where lies what was carried over.
void end_packet(Camera outlet, uint first, uint end, uint before_late, int64_t free_ps, uint carried_place) {
    const uint lane = gl_LocalInvocationID.x;
    // Not where those lie that were carried over: others may still read them.
    const uint place = carried_place < MOST_CARRIED ? 2u * MOST_CARRIED : 0u;
    for (uint e = first + lane; e < end; e += gl_WorkGroupSize.x) {
        if (STAMP(e) == LATE) {
            const uint late = atomicAdd(count_late, 1u);
            if (late < MOST_CARRIED) {
                gathered[outlet.event_base + place + late] =
                    uvec2(uint(left_ps(e) / 1000l), tile_key(e).y | DEFERRED);
            }
        }
    }
    barrier();
    if (lane == 0u) {
        const uint counter = 2u * outlet.slot + outlet.frame_slot;
        bus[at_free(1u - outlet.frame_slot)] = max(free_ps - int64_t(outlet.interval_ns) * 1000l, 0l);
        counters[counter].packet = place;
        counters[counter].deferred = count_late;
        report[outlet.slot].packet = before_late - count_late;
        report[outlet.slot].deferred = count_late;
        if (count_late > MOST_CARRIED) {
            gives_up = true;
        }
    }
}

// Makes the outlet's counters and bins ready for `readout`. The last group writes the others of the counters.
void prepare_outlet(Camera outlet, uint first_bin) {
    const uint lane = gl_LocalInvocationID.x;
    for (uint b = first_bin + lane; b < min(first_bin + GROUP_BINS, outlet.bin_count + 1u); b += gl_WorkGroupSize.x) {
        bins[bins_of(outlet, outlet.frame_slot) + b] = 0u;
    }
    if (gl_WorkGroupID.x == 0u && lane == 0u) {
        const uint counter = 2u * outlet.slot + outlet.frame_slot;
        counters[counter].overflow = 0u;
        counters[counter].heavy = 0u;
        counters[counter].gathered_deferred = 0u;
        counters[counter].lost = 0u;
        counters[counter].capped = 0u;
        counters[counter].waiting = 0u;
        counters[counter].progress = 0u;
    }
}

// Serves the tile whose events are in order. `base`: the packet's number of its first event; `own`: first and end of
// those that are the group's.
void serve_tile(Camera cam, Camera outlet, uint first_bin, uint base, uvec2 own, uint length, uint packet) {
    const uint lane = gl_LocalInvocationID.x;
    const bool by_row = readout.row_ps != 0ul;
    const int64_t service_ps = int64_t(readout.row_ps + readout.event_ps);
    const uint last = 2u * outlet.slot + 1u - outlet.frame_slot;
    const uint carried = counters[last].deferred;
    const uint carried_place = counters[last].packet;
    const int64_t start_ps = bus[at_free(outlet.frame_slot)];
    const int64_t bin_ps = int64_t(cam.bin_width) * 1000l;
    // As many events as come in a bin are served in no more time than the bin lasts.
    const bool is_light = readout.cap_events == 0u && cam.bin_rows == 1u && !bin_samples(cam)
        && carried <= MOST_CARRIED && bus[at_head(HEAD_SERVICES)] == 0l && start_ps <= bin_ps
        && int64_t(sum_largest) * service_ps <= bin_ps;
    if (!is_light) {
        gives_up = true;
        return;
    }
    load_carried(outlet, carried, carried_place);
    // If the events of the bin before the tile came at its end. The packet's first events know when the bus is free.
    const int64_t bound_ps = int64_t(max(first_bin, 1u) - 1u) * bin_ps + int64_t(sum_largest) * service_ps;
    const int64_t free_ps = base == 0u ? start_ps : bound_ps;
    const uint first_certain = find_latest(length, free_ps, service_ps);
    const uint certain = base == 0u ? 0u : first_certain;
    if (lane == 0u) {
        cluster_first = NONE;
        cluster_end = NONE;
    }
    barrier();
    const bool reaches_end = base + length == packet;
    for (uint e = own.x + lane; e <= length; e += gl_WorkGroupSize.x) {
        const bool is_event = e < length;
        // After the last bin there may be another event.
        const int64_t now = is_event ? now_ps(e) : int64_t(first_bin + GROUP_BINS + 1u) * bin_ps;
        const int64_t ahead_ps = e == 0u ? free_ps : latest_ps(e - 1u);
        const int64_t leaves_ps = by_row ? now + service_ps : max(ahead_ps, now) + service_ps;
        const bool differs =
            stamp_offset(outlet, uint(ahead_ps / 1000l)) != stamp_offset(outlet, uint(leaves_ps / 1000l));
        const bool starts =
            (base + e == 0u && is_event) || (!is_event && reaches_end) || ((!by_row || ahead_ps < now) && differs);
        if (is_event) {
            BEGINS(e) = uint16_t(starts);
        }
        // If the bus may be free earlier, a cluster that begins does so all the same. Another may, and its other group
        // must find the same.
        const bool is_known = base == 0u || (e > 0u && certain < e);
        if (!starts && !is_known) {
            gives_up = true;
        }
        if (is_event && !by_row
            && (certain > e || (e < own.y && may_be_lost(e, base == 0u ? NEVER : free_ps, carried)))) {
            gives_up = true;
        }
        if (starts) {
            if (e < own.y) {
                atomicMin(cluster_first, e);
            } else {
                atomicMin(cluster_end, e);
            }
        }
    }
    barrier();
    const uint end = cluster_end;
    const uint first = min(cluster_first, end);
    const bool is_last = end == length && reaches_end;
    if (end == NONE && first != NONE) {
        gives_up = true;
    }
    if (end == NONE || (first == end && packet != 0u)) {
        return;
    }
    if (by_row) {
        for (uint e = first + lane; e < end; e += gl_WorkGroupSize.x) {
            if (BEGINS(e) == uint16_t(0)) {
                continue;
            }
            uint after = e + 1u;
            while (after < end && BEGINS(after) == uint16_t(0)) {
                after += 1u;
            }
            const bool is_packets_first = base + e == 0u;
            if (after - e > MOST_CLUSTER
                || !serve_cluster(cam, e, after, is_packets_first ? start_ps : 0l, is_packets_first ? carried : 0u)) {
                gives_up = true;
            }
        }
        barrier();
    }
    for (uint e = first + lane; e < end; e += gl_WorkGroupSize.x) {
        const int64_t left_ns = left_ps(e) / 1000l;
        const bool is_late = left_ns > int64_t(outlet.interval_ns);
        STAMP(e) = is_late ? LATE : stamp_offset(outlet, uint(left_ns));
        if (is_late && !is_last) {
            gives_up = true;
        }
    }
    barrier();
    for (uint e = first + lane; e < end; e += gl_WorkGroupSize.x) {
        place_in_cluster(e, end);
    }
    barrier();
    if (base + first == 0u) {
        write_carried(outlet, carried, first, end);
    }
    write_served(outlet, base + first, first, end, carried);
    if (is_last) {
        // By row, the last service ends last, whichever event it is of.
        int64_t last_ps = packet == 0u ? start_ps : left_ps(end - 1u);
        for (uint e = end - 1u; packet != 0u && BEGINS(e) == uint16_t(0); --e) {
            last_ps = max(last_ps, left_ps(e - 1u));
        }
        end_packet(outlet, first, end, carried + packet, last_ps, carried_place);
    }
}

// Sorts the group's events, leaves them for `readout`, and serves them. Returns false if there are too many, and
// nothing is done.
bool serve_group(Camera cam, Camera outlet, uint first_bin, Sums all) {
    const uint lane = gl_LocalInvocationID.x;
    const uint own = bins_of(cam, cam.frame_slot);
    if (lane <= TILE_BINS) {
        uint offset = 0u;
        for (uint b = 0u; b < lane; ++b) {
            const uint bin = first_bin + b;
            offset += bin >= 1u && bin <= cam.bin_count ? bins[own + bin - 1u] : 0u;
        }
        tile_offsets[lane] = offset;
    }
    if (lane == 0u) {
        gives_up = false;
        cluster_first = NONE;
        count_late = 0u;
    }
    barrier();
    const uint length = tile_offsets[TILE_BINS];
    if (length > MOST_SERVED || all.largest_bin > min(RANKED_BIN_EVENTS, cam.bin_capacity)) {
        return false;
    }
    load_tile(cam, first_bin, length);
    const uvec2 part = uvec2(tile_offsets[1], tile_offsets[GROUP_BINS + 1u]);
    for (uint e = part.x + lane; e < part.y; e += gl_WorkGroupSize.x) {
        gathered[cam.event_base + all.ahead + e - part.x] = tile_key(e);
    }
    serve_tile(cam, outlet, first_bin, all.ahead - part.x, part, length, all.packet);
    barrier();
    if (gives_up && lane == 0u) {
        report[outlet.slot].progress = READOUT_UNDONE;
    }
    return true;
}
