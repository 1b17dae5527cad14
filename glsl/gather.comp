// gather: concatenates the packets of all cameras, camera by camera. Four arrays, one behind the other: times in
// absolute nanoseconds, columns, rows, polarities.
//
// 256 threads per workgroup, striding over a camera's events; y over cameras. Columns and rows are int16_t: a sensor
// has at most 16384, and more programs can compute with signed numbers.
#version 460
#extension GL_GOOGLE_include_directive : require
#include "common.glsl"
#include "slices.glsl"

layout(local_size_x = 256) in;

layout(buffer_reference, std430) writeonly buffer Times { int64_t v[]; };
layout(buffer_reference, std430) writeonly buffer Coordinates { int16_t v[]; };
layout(buffer_reference, std430) writeonly buffer Signs { uint8_t v[]; };

void main() {
    const Slice slice = slice_of_workgroup();
    const uint64_t all = uint64_t(push.events);
    Times times = Times(push.target);
    Coordinates columns = Coordinates(push.target + 8ul * all);
    Coordinates rows = Coordinates(push.target + 10ul * all);
    Signs signs = Signs(push.target + 12ul * all);
    const uint stride = gl_NumWorkGroups.x * gl_WorkGroupSize.x;
    for (uint e = gl_GlobalInvocationID.x; e < slice.events; e += stride) {
        const uint from = slice.event_base + e;
        const uint to = slice.events_before + e;
        times.v[to] = slice.base_ns + int64_t(event_t[from]);
        columns.v[to] = int16_t(event_x[from]);
        rows.v[to] = int16_t(event_y[from]);
        signs.v[to] = event_p[from];
    }
}
