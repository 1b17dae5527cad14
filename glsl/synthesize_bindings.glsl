// Buffers of the kernels of `synthesize`, but for those that they share with no other or access differently.

BUFFER(readonly, SLOT_PLANES, float, planes);
BUFFER(readonly, SLOT_MOTION, vec2, motion);
BUFFER(readonly, SLOT_BLOCKS, uvec4, blocks);
#include "surface_bindings.glsl"
BUFFER(readonly, SLOT_MEETINGS, uint, meetings);
