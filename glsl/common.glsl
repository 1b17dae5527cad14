// What every kernel shares: extensions, generated layouts, bindings, the camera of a workgroup.
//
// Loops that are dear test at their end where that costs a GPU nothing: the software driver goes through the body of
// one that tests first once more, for no thread at all.
#extension GL_EXT_shader_explicit_arithmetic_types_int8 : require
#extension GL_EXT_shader_explicit_arithmetic_types_int16 : require
#extension GL_EXT_shader_explicit_arithmetic_types_int64 : require
#extension GL_EXT_shader_8bit_storage : require
#extension GL_EXT_shader_16bit_storage : require
#extension GL_EXT_control_flow_attributes : require
#include "layout.glsl"

// Declares a storage buffer; `access` is readonly, writeonly or empty, stated for every binding so
// that synchronisation validation can tell readers from writers.
#define BUFFER(access, SLOT, TYPE, name) \
    layout(set = 0, binding = SLOT, std430) access restrict buffer Buffer_##name { TYPE name[]; }

// The table of cameras: a uniform buffer, since every thread of a workgroup reads the same row.
layout(set = 0, binding = SLOT_CAMERAS, std140) uniform Buffer_cameras { Camera cameras[MAX_CAMERAS]; };

// Linear interpolation in two roundings, the same ones in every kernel: what `mix` is made of is left to drivers.
float blend(float a, float b, float t) {
    return fma(t, b - a, a);
}

vec2 blend(vec2 a, vec2 b, float t) {
    return fma(vec2(t), b - a, a);
}

// Log intensity as pixels keep it.
int to_q24(float log_intensity) {
    return int(roundEven(log_intensity * LOG_SCALE));
}

const uint PHASE_FIRST = 1u;
const uint PHASE_INTERVAL = 2u;
