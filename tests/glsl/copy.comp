// copy: one thread copies the first element of one buffer to another.
#version 460
layout(local_size_x = 1) in;
layout(set = 0, binding = 0, std430) readonly restrict buffer Source { uint source[]; };
layout(set = 0, binding = 1, std430) writeonly restrict buffer Target { uint target[]; };

void main() {
    target[0] = source[0];
}
