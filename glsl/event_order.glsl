// The order of a packet, (t, y, x, polarity), and an event's way into the packet's arrays. Needs BRANCHES.

#include "quotient.glsl"

bool before(uvec2 a, uvec2 b) {
    return a.x < b.x || (a.x == b.x && a.y < b.y);
}

void write_out(Camera cam, uint position, uvec2 event) {
    const uint pixel = event.y >> 1;
    const uint y = quotient(pixel, cam.width);
    event_t[position] = event.x;
    event_x[position] = uint16_t(pixel - y * cam.width);
    event_y[position] = uint16_t(y);
    event_p[position] = uint8_t(event.y & 1u);
}
