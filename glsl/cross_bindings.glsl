// Buffers of `cross`, see cross.glsl.

BUFFER(, SLOT_COUNTERS, Counters, counters);
BUFFER(readonly, SLOT_PLANES, float, planes);
BUFFER(readonly, SLOT_MOTION, vec2, motion);
BUFFER(, SLOT_STATE, uint, state);
BUFFER(, SLOT_BLOCKS, uvec4, blocks);
BUFFER(readonly, SLOT_TILE_ORDER, uint, tile_order);
BUFFER(, SLOT_BINS, uint, bins);
BUFFER(writeonly, SLOT_BIN_STORAGE, uvec2, bin_storage);
BUFFER(writeonly, SLOT_OVERFLOW, uvec2, overflow);
BUFFER(writeonly, SLOT_APS, uint16_t, aps);
BUFFER(writeonly, SLOT_SAMPLES, int, samples_out);
#include "surface_bindings.glsl"
BUFFER(readonly, SLOT_MEETINGS, uint, meetings);
#ifdef READS_LEVELS
BUFFER(readonly, SLOT_LEVELS, uint, levels);
BUFFER(readonly, SLOT_LEVEL_WORDS, uvec4, level_words);
#endif
