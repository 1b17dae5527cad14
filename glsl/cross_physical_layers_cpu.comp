// cross where motions meet, for the software driver: see cross_cpu.glsl.
// Only for synthesis `motion`, with the physical pixel. A kernel of its own, so that the other tiles keep a small one.
#version 460
#extension GL_GOOGLE_include_directive : require

#define RIGID false
#define LAYERED true
#define PHYSICAL
#include "cross_cpu.glsl"
