// ingest, for the software driver: see ingest_cpu.glsl.
// For every synthesis but `rigid`.
#version 460
#extension GL_GOOGLE_include_directive : require

#define RIGID false
#include "ingest_cpu.glsl"
