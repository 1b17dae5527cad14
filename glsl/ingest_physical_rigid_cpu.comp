// ingest along exact paths, for the software driver: see ingest_cpu.glsl.
// For the physical pixel and synthesis `rigid`.
#version 460
#extension GL_GOOGLE_include_directive : require

#define RIGID true
#define PHYSICAL
#include "ingest_cpu.glsl"
