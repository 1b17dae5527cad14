// ingest, for the software driver: see ingest_cpu.glsl.
// For the physical pixel and every synthesis but `rigid`.
#version 460
#extension GL_GOOGLE_include_directive : require

#define RIGID false
#define PHYSICAL
#include "ingest_cpu.glsl"
