// Buffers of the kernels of `synthesize`, but for those that they share with no other or access differently.

BUFFER(readonly, SLOT_PLANES, float, planes);
BUFFER(readonly, SLOT_MOTION, vec2, motion);
BUFFER(readonly, SLOT_BLOCKS, uvec4, blocks);
BUFFER(readonly, SLOT_SURFACES, uvec2, surfaces);
BUFFER(readonly, SLOT_SLOPES, uint, slopes);
BUFFER(readonly, SLOT_POSES, vec4, poses);
BUFFER(readonly, SLOT_PATHS, vec4, paths);
BUFFER(readonly, SLOT_REPRESENTATIVES, uint, representatives);
BUFFER(readonly, SLOT_PASSING, uint, passing);
BUFFER(readonly, SLOT_MEETINGS, uint, meetings);
