// cross, for GPUs: see cross_gpu.glsl.
// For every synthesis but `rigid`.
#version 460
#extension GL_GOOGLE_include_directive : require

#define RIGID false
#define LAYERED false
#include "cross_gpu.glsl"
