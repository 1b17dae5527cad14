// ingest, for GPUs: see ingest_gpu.glsl.
// For the physical pixel and every synthesis but `rigid`.
#version 460
#extension GL_GOOGLE_include_directive : require

#define RIGID false
#define PHYSICAL
#include "ingest_gpu.glsl"
