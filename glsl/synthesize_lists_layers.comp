// synthesize, lists of layers where motions meet: see synthesize_lists.glsl.
#version 460
#extension GL_GOOGLE_include_directive : require

#define RIGID false
#define LAYERED true
#include "synthesize_lists.glsl"
