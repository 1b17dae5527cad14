// backward_transfer along exact paths: see backward_transfer.glsl.
// Only for synthesis `rigid`, whose code makes a kernel several times as large.
#version 460
#extension GL_GOOGLE_include_directive : require

#define RIGID true
#include "backward_transfer.glsl"
