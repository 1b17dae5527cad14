// ingest, the surfaces of a frame and their lists, for GPUs: see ingest_gpu.glsl.
// Only for synthesis `rigid`, for either pixel. Runs alongside the kernel that makes the frame.
#version 460
#extension GL_GOOGLE_include_directive : require

#define RIGID true
#define MAKES_LISTS true
#define MAKES_FRAME false
#include "ingest_gpu.glsl"
