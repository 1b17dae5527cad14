// Keeps a GPU at its working clock between the ticks of a bench: arithmetic for about a millisecond.
#version 460

layout(local_size_x = 256) in;
layout(set = 0, binding = 0, std430) writeonly buffer Sink { float sink[]; };
layout(push_constant) uniform Push { uint rounds; } push;

void main() {
    float value = float(gl_GlobalInvocationID.x);
    for (uint i = 0u; i < push.rounds; ++i) {
        value = value * 1.0000001 + 0.5;
    }
    if (value == -1.0) {
        sink[0] = value;
    }
}
