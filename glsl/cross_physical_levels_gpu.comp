// cross of levels that `synthesize` has made, for GPUs: see cross_gpu.glsl.
// As cross_levels_gpu.comp, for the physical pixel.
#version 460
#extension GL_GOOGLE_include_directive : require

#define READS_LEVELS
#define RIGID (SYNTHESIS == SYNTHESIS_RIGID)
#define LAYERED (LAYERS > 1u)
#define PHYSICAL
#include "cross_gpu.glsl"
