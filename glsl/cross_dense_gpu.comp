// cross of a log pixel with many events, for GPUs: see cross_gpu.glsl.
// For every synthesis but `rigid`.
#version 460
#extension GL_GOOGLE_include_directive : require

#define RIGID false
#define LAYERED false
#define LEVELS_FIRST
#include "cross_gpu.glsl"
