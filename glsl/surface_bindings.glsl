// Buffers of surfaces and their paths, for kernels that read what `ingest`, `poses` and `paths` have made.

BUFFER(readonly, SLOT_SURFACES, uvec2, surfaces);
BUFFER(readonly, SLOT_SLOPES, uint, slopes);
BUFFER(readonly, SLOT_POSES, vec4, poses);
BUFFER(readonly, SLOT_PATHS, vec4, paths);
BUFFER(readonly, SLOT_REPRESENTATIVES, uint, representatives);
BUFFER(readonly, SLOT_PASSING, uint, passing);
