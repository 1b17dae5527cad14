// Copies one buffer to another, as fast as the memory allows.
#version 460

layout(local_size_x = 256) in;
layout(set = 0, binding = 0, std430) readonly buffer From { uvec4 from[]; };
layout(set = 0, binding = 1, std430) writeonly buffer To { uvec4 to[]; };
layout(push_constant) uniform Push { uint count; } push;

void main() {
    uint stride = gl_NumWorkGroups.x * gl_WorkGroupSize.x;
    for (uint i = gl_GlobalInvocationID.x; i < push.count; i += stride) {
        to[i] = from[i];
    }
}
