// The order of a packet, (t, y, x, polarity), and the write of an event to the packet's arrays. Needs `fast_udiv`.

bool before(uvec2 a, uvec2 b) {
    return a.x < b.x || (a.x == b.x && a.y < b.y);
}

void write_out(Camera cam, uint position, uvec2 event) {
    const uint pixel = event.y >> 1;
    const uint y = fast_udiv(pixel, cam.width);
    event_t[position] = event.x;
    event_x[position] = uint16_t(pixel - y * cam.width);
    event_y[position] = uint16_t(y);
    event_p[position] = uint8_t(event.y & 1u);
}
