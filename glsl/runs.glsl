// Short runs of events in the order of (t, y, x, polarity), ranked in shared memory. Needs the packet's arrays.

shared uvec2 keys[SORTABLE_EVENTS];

bool before(uvec2 a, uvec2 b) {
    return a.x < b.x || (a.x == b.x && a.y < b.y);
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

void write_out(Camera cam, uint position, uvec2 event) {
    const uint pixel = event.y >> 1;
    const uint y = pixel / cam.width;
    event_t[position] = event.x;
    event_x[position] = uint16_t(pixel - y * cam.width);
    event_y[position] = uint16_t(y);
    event_p[position] = uint8_t(event.y & 1u);
}
