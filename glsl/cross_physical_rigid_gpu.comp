// cross along exact paths, for GPUs: see cross_gpu.glsl.
// For the physical pixel and synthesis `rigid`.
#version 460
#extension GL_GOOGLE_include_directive : require

#define RIGID true
#define LAYERED false
#define PHYSICAL
#include "cross_gpu.glsl"
