// cross of a log pixel with many events, of levels that `synthesize` has made, for GPUs: see cross_gpu.glsl.
// For synthesis `rigid`, and for the tiles where motions meet with synthesis `motion`.
#version 460
#extension GL_GOOGLE_include_directive : require

#define READS_LEVELS
#define RIGID (SYNTHESIS == SYNTHESIS_RIGID)
#define LAYERED (LAYERS > 1u)
#define LEVELS_FIRST
#include "cross_gpu.glsl"
