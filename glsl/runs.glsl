// Runs of events in the order of (t, y, x, polarity): ranked in shared memory while they are short, then
// merged two by two from `staged` to `binned` and back, each event finding its place by binary search.
// Needs `staged`, `binned` and the packet's arrays.

shared uvec2 keys[GROUP_EVENTS];
shared uvec2 ranked[GROUP_EVENTS];

bool before(uvec2 a, uvec2 b) {
    return a.x < b.x || (a.x == b.x && a.y < b.y);
}

void write_out(Camera cam, uint position, uvec2 event) {
    const uint pixel = event.y >> 1;
    const uint y = pixel / cam.width;
    event_t[position] = event.x;
    event_x[position] = uint16_t(pixel - y * cam.width);
    event_y[position] = uint16_t(y);
    event_p[position] = uint8_t(event.y & 1u);
}

uvec2 read_run(bool from_binned, uint position) {
    return from_binned ? binned[position] : staged[position];
}

void write_run(bool to_binned, uint position, uvec2 event) {
    if (to_binned) {
        binned[position] = event;
    } else {
        staged[position] = event;
    }
}

// How many of keys [first, last) come before key `e` of them; among equals, the first.
uint rank_among(uint e, uint first, uint last) {
    const uvec2 key = keys[e];
    uint rank = 0u;
    for (uint other = first; other < last; ++other) {
        rank += uint(before(keys[other], key) || (keys[other] == key && other < e));
    }
    return rank;
}

// The `length` events of `binned` from `first` on, in order, into `ranked`, by a whole workgroup. It may
// be called again at once: its first barrier waits for those who still read `ranked`.
void rank_run(uint first, uint length) {
    const uint lane = gl_LocalInvocationID.x;
    for (uint e = lane; e < length; e += gl_WorkGroupSize.x) {
        keys[e] = binned[first + e];
    }
    barrier();
    for (uint e = lane; e < length; e += gl_WorkGroupSize.x) {
        ranked[rank_among(e, 0u, length)] = keys[e];
    }
    barrier();
}

// Elements of the sorted run [first, last) that belong before `key`; among equals, the left run first.
uint place(bool in_binned, uint first, uint last, uvec2 key, bool equals_too) {
    uint low = first;
    uint high = last;
    while (low < high) {
        const uint middle = (low + high) / 2u;
        const uvec2 other = read_run(in_binned, middle);
        if (before(other, key) || (equals_too && other == key)) {
            low = middle + 1u;
        } else {
            high = middle;
        }
    }
    return low - first;
}

// Where `key`, which is event `e` of [first, last) in runs of `width`, goes when they are merged two by two.
uint merged(bool in_binned, uint first, uint last, uint width, uint e, uvec2 key) {
    const uint pair = first + ((e - first) / (2u * width)) * (2u * width);
    const uint middle = min(pair + width, last);
    const uint end = min(pair + 2u * width, last);
    return e < middle ? e + place(in_binned, middle, end, key, false)
                      : pair + (e - middle) + place(in_binned, pair, middle, key, true);
}
