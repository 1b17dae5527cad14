// synthesize, levels where motions meet: see synthesize_levels.glsl.
#version 460
#extension GL_GOOGLE_include_directive : require

#define RIGID false
#define LAYERED true
#include "synthesize_levels.glsl"
