// Loads of surfaces and poses through texel buffers, unless BY_ADDRESS: see frame_load_by_texel.glsl. Only for kernels that
// write none of these buffers. Macros, since not every kernel has all of them.

layout(set = 0, binding = SLOT_SURFACE_TEXELS) uniform utextureBuffer surface_texels;
layout(set = 0, binding = SLOT_SLOPE_TEXELS) uniform utextureBuffer slope_texels;
layout(set = 0, binding = SLOT_POSE_TEXELS) uniform textureBuffer pose_texels;
layout(set = 0, binding = SLOT_PATH_TEXELS) uniform textureBuffer path_texels;

#define SURFACE_WORDS(element) (BY_ADDRESS ? surfaces[element] : texelFetch(surface_texels, int(element)).xy)
#define SLOPE_WORD(element) (BY_ADDRESS ? slopes[element] : texelFetch(slope_texels, int(element)).x)
#define POSE_ROW(row) (BY_ADDRESS ? poses[row] : texelFetch(pose_texels, int(row)))
#define PATH_ROW(row) (BY_ADDRESS ? paths[row] : texelFetch(path_texels, int(row)))
