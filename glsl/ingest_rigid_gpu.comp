// ingest along exact paths, for GPUs: see ingest_gpu.glsl.
// Only for synthesis `rigid`, whose code makes a kernel several times as large.
#version 460
#extension GL_GOOGLE_include_directive : require

#define RIGID true
#include "ingest_gpu.glsl"
