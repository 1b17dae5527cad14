// synthesize, levels along exact paths: see synthesize_levels.glsl.
#version 460
#extension GL_GOOGLE_include_directive : require

#define RIGID true
#define LAYERED false
#include "synthesize_levels.glsl"
