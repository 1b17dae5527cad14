// synthesize, lists of candidates for synthesis `rigid`: see synthesize_lists.glsl.
#version 460
#extension GL_GOOGLE_include_directive : require

#define RIGID true
#define LAYERED false
#include "synthesize_lists.glsl"
