// backward_transfer: see backward_transfer.glsl.
// For every synthesis but `rigid`.
#version 460
#extension GL_GOOGLE_include_directive : require

#define RIGID false
#include "backward_transfer.glsl"
