// detail_transfer along exact paths: see detail_transfer.glsl.
// Only for synthesis `rigid`, whose code makes a kernel several times as large.
#version 460
#extension GL_GOOGLE_include_directive : require

#define RIGID true
#include "detail_transfer.glsl"
