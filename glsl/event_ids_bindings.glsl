// Buffers of the kernels of `event_ids`.

BUFFER(readonly, SLOT_SURFACES, uvec2, surfaces);
BUFFER(readonly, SLOT_SLOPES, uint, slopes);
BUFFER(readonly, SLOT_POSES, vec4, poses);
BUFFER(readonly, SLOT_PATHS, vec4, paths);
BUFFER(readonly, SLOT_REPRESENTATIVES, uint, representatives);
BUFFER(readonly, SLOT_PASSING, uint, passing);

// The kind of the camera's lens. No constant: these kernels run on request, and one dispatch takes all cameras.
bool FISHEYE;
