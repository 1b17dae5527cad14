// cross, for GPUs: see cross_gpu.glsl.
// For the physical pixel and every synthesis but `rigid`.
#version 460
#extension GL_GOOGLE_include_directive : require

#define RIGID false
#define LAYERED false
#define PHYSICAL
#include "cross_gpu.glsl"
