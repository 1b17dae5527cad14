// ingest, for the software driver: see ingest.glsl. A thread costs much before its first pixel, so a workgroup has a
// thread for each pixel of a row and walks down the tile, for all colour components.
#extension GL_EXT_buffer_reference : require
#extension GL_EXT_buffer_reference_uvec2 : require
#include "common.glsl"
#include "ingest_constants.glsl"
#include "ingest_cpu_constants.glsl"
#include "random.glsl"
#include "optics.glsl"
#include "substeps.glsl"
#include "tiles.glsl"

layout(local_size_x = INGEST_THREADS, local_size_x_id = THREADS_ID) in;

#include "ingest_bindings.glsl"

const uint CHANNELS = INTENSITY == INTENSITY_BAYER_RGGB ? 3u : 1u;
// Colour components that a workgroup takes.
const uint COMPONENTS = CHANNELS;

bool is_first(Camera cam) {
    return MAY_BE_FIRST && cam.frame_kind == FRAME_FIRST;
}

#define MAKES_LISTS RIGID
#define MAKES_FRAME true

uint first_component() {
    return 0u;
}

#include "frame_load_by_texel.glsl"
#include "store_by_word.glsl"
#include "ingest.glsl"
