// checksum: a 64-bit sum over a buffer's words in which each word's place counts; `sums` is zero before.
#version 460
layout(local_size_x = 64) in;
layout(push_constant) uniform Push { uint words; } push;
layout(set = 0, binding = 0, std430) readonly restrict buffer Source { uint source[]; };
layout(set = 0, binding = 1, std430) restrict buffer Sums { uint sums[2]; };

// A permutation of 32-bit words that spreads every bit.
uint mixed(uint word) {
    word = (word ^ (word >> 16)) * 0x7feb352du;
    word = (word ^ (word >> 15)) * 0x846ca68bu;
    return word ^ (word >> 16);
}

void main() {
    const uint index = gl_GlobalInvocationID.x;
    if (index < push.words) {
        atomicAdd(sums[0], mixed(source[index] ^ mixed(index)));
        atomicAdd(sums[1], mixed(source[index] + mixed(index + 0x9e3779b9u)));
    }
}
