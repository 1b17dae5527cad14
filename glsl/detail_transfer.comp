// detail_transfer: see detail_transfer.glsl.
// For every synthesis but `rigid`.
#version 460
#extension GL_GOOGLE_include_directive : require

#define RIGID false
#include "detail_transfer.glsl"
