// Buffers of `ingest`, see ingest.glsl.

BUFFER(, SLOT_COUNTERS, Counters, counters);
BUFFER(, SLOT_PLANES, float, planes);
BUFFER(, SLOT_MOTION, vec2, motion);
BUFFER(, SLOT_STATE, uint, state);
BUFFER(writeonly, SLOT_BLOCKS, uvec4, blocks);
BUFFER(writeonly, SLOT_TILE_ORDER, uint, tile_order);

layout(buffer_reference, std430) readonly buffer Words1 { uint v[]; };
layout(buffer_reference, std430) readonly buffer Words2 { uvec2 v[]; };
layout(buffer_reference, std430) readonly buffer Floats2 { vec2 v[]; };
layout(buffer_reference, std430) readonly buffer Floats4 { vec4 v[]; };
