// Shared by kernels that read packets: the packet's arrays, and a slice of them for each camera.
#extension GL_EXT_buffer_reference : require

BUFFER(readonly, SLOT_EVENT_T, uint, event_t);
BUFFER(readonly, SLOT_EVENT_X, uint16_t, event_x);
BUFFER(readonly, SLOT_EVENT_Y, uint16_t, event_y);
BUFFER(readonly, SLOT_EVENT_P, uint8_t, event_p);

layout(buffer_reference, std430) readonly buffer Slices { Slice v[]; };
layout(buffer_reference, std430) buffer Ints { int v[]; };
layout(buffer_reference, std430) buffer Words { uint v[]; };

// Time of an event from the interval's start on. A floored time stamp may lie before the interval, a deferred one belongs to
// it.
uint since_start_ns(Slice slice, uint offset_ns) {
    return min(offset_ns - min(offset_ns, slice.base_to_start_ns), slice.interval_ns);
}

Slice slice_of_workgroup() {
    return Slices(push.slices).v[gl_WorkGroupID.y];
}
