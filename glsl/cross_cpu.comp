// cross, for the software driver: see cross_cpu.glsl.
// For every synthesis but `rigid`.
#version 460
#extension GL_GOOGLE_include_directive : require

#define RIGID false
#define LAYERED false
#include "cross_cpu.glsl"
