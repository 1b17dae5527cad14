// ingest along exact paths, for GPUs: see ingest_gpu.glsl.
// For the physical pixel and synthesis `rigid`.
#version 460
#extension GL_GOOGLE_include_directive : require

#define RIGID true
#define PHYSICAL
#include "ingest_gpu.glsl"
