// write: one thread writes element `index` of its buffer, wherever that is.
#version 460
layout(local_size_x = 1) in;
layout(set = 0, binding = 0, std430) writeonly restrict buffer Target { uint target[]; };
layout(push_constant) uniform Push { uint index; } push;

void main() {
    target[push.index] = 7u;
}
