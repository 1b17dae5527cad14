// Buffers of the kernels of `event_ids`.

#include "surface_bindings.glsl"

// The kind of the camera's lens. No constant: these kernels run on request, and one dispatch takes all cameras.
bool FISHEYE;
