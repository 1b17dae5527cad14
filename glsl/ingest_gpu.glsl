// ingest, for GPUs: see ingest.glsl. One thread per pixel of a tile. If frames become half-pel frames, a workgroup
// takes one colour component (z): one sensor has few tiles, and smaller pieces of work fill the GPU better.
#extension GL_EXT_buffer_reference : require
#extension GL_EXT_buffer_reference_uvec2 : require
#include "common.glsl"
#include "ingest_constants.glsl"
#include "random.glsl"
#include "optics.glsl"
#include "substeps.glsl"
#include "tiles.glsl"

layout(local_size_x = INGEST_THREADS) in;

#include "ingest_bindings.glsl"

const uint CHANNELS = INTENSITY == INTENSITY_BAYER_RGGB ? 3u : 1u;
// Colour components that a workgroup takes.
const uint COMPONENTS = HALF_PEL ? 1u : CHANNELS;

bool is_first(Camera cam) {
    return cam.frame_kind == FRAME_FIRST;
}

// Surfaces and lists are a chain of steps that takes as long as all else. So ingest_surfaces_gpu.comp makes them alongside.
#ifndef MAKES_LISTS
#define MAKES_LISTS false
#define MAKES_FRAME true
#endif

// Keep dynamic: as a constant the compiler hoists loads, raises register use and costs a quarter of occupancy.
uint first_component() {
    return HALF_PEL ? gl_WorkGroupID.z : 0u;
}

#include "frame_load_by_address.glsl"
#include "store_by_address.glsl"
#include "ingest.glsl"
