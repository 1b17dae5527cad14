// Buffers of `ingest`, see ingest.glsl.

BUFFER(, SLOT_COUNTERS, Counters, counters);
BUFFER(, SLOT_PLANES, float, planes);
BUFFER(, SLOT_MOTION, vec2, motion);
BUFFER(, SLOT_STATE, uint, state);
BUFFER(writeonly, SLOT_BLOCKS, uvec4, blocks);
BUFFER(writeonly, SLOT_TILE_ORDER, uint, tile_order);
BUFFER(readonly, SLOT_INSTANCES, uvec2, instances);
BUFFER(readonly, SLOT_POSES, vec4, poses);
BUFFER(, SLOT_SURFACES, uvec2, surfaces);
BUFFER(, SLOT_SLOPES, uint, slopes);
BUFFER(, SLOT_REPRESENTATIVES, uint, representatives);
BUFFER(, SLOT_PASSING, uint, passing);
BUFFER(, SLOT_MEETINGS, uint, meetings);

layout(buffer_reference, std430) readonly buffer Words1 { uint v[]; };
layout(buffer_reference, std430) readonly buffer Words2 { uvec2 v[]; };
layout(buffer_reference, std430) readonly buffer Floats2 { vec2 v[]; };
layout(buffer_reference, std430) readonly buffer Floats4 { vec4 v[]; };
