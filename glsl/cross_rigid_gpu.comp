// cross along exact paths, for GPUs: see cross_gpu.glsl.
// Only for synthesis `rigid`, whose code makes a kernel several times as large.
#version 460
#extension GL_GOOGLE_include_directive : require

#define RIGID true
#define LAYERED false
#include "cross_gpu.glsl"
