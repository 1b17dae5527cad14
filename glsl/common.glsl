// Shared by all kernels: extensions, generated layouts, bindings, fixed point.
//
// Hot loops are do-while: the software driver runs a while body once more with all lanes masked.
#extension GL_EXT_shader_explicit_arithmetic_types_int8 : require
#extension GL_EXT_shader_explicit_arithmetic_types_int16 : require
#extension GL_EXT_shader_explicit_arithmetic_types_int64 : require
#extension GL_EXT_shader_8bit_storage : require
#extension GL_EXT_shader_16bit_storage : require
#extension GL_EXT_control_flow_attributes : require
#include "layout.glsl"

// Declares a storage buffer. `access` is readonly, writeonly or empty; every binding states it, so that synchronisation
// validation can tell readers from writers.
#define BUFFER(access, SLOT, TYPE, name) \
    layout(set = 0, binding = SLOT, std430) access restrict buffer Buffer_##name { TYPE name[]; }

// The table of cameras. A uniform buffer, because all threads of a workgroup read the same row.
layout(set = 0, binding = SLOT_CAMERAS, std140) uniform Buffer_cameras { Camera cameras[MAX_CAMERAS]; };

// What synthesis `rigid` knows of the cameras, by their `slot`.
layout(set = 0, binding = SLOT_GEOMETRIES, std140) uniform Buffer_geometries { Geometry geometries[MAX_CAMERAS]; };

// Linear interpolation with two roundings, the same in every kernel; how `mix` rounds is up to the driver.
float lerp(float a, float b, float t) {
    return fma(t, b - a, a);
}

vec2 lerp(vec2 a, vec2 b, float t) {
    return fma(vec2(t), b - a, a);
}

// Log intensity in the fixed point of pixels (Q7.24).
int to_q24(float log_intensity) {
    return int(roundEven(log_intensity * LOG_SCALE));
}
