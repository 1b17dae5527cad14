// Reading `planes` and `motion`. Needs both, and BY_ADDRESS: whether the device reads fastest by address, as GPUs do.
// The software driver reads a storage buffer lane after lane, whatever it is asked for, and texels eight at once.

layout(set = 0, binding = SLOT_PLANE_TEXELS) uniform textureBuffer plane_texels;
layout(set = 0, binding = SLOT_MOTION_TEXELS) uniform textureBuffer motion_texels;

// A word of `planes` that this kernel does not write.
float plane_at(uint word) {
    return BY_ADDRESS ? planes[word] : texelFetch(plane_texels, int(word)).x;
}

// An element of `motion` that this kernel does not write.
vec2 vector_at(uint element) {
    return BY_ADDRESS ? motion[element] : texelFetch(motion_texels, int(element)).xy;
}
