// Renders an analytic scene: linear radiance, motion vectors, depth and instance ids at every pixel centre.
// `view.rs` evaluates the same formulas in f64.
//
// Bindings (set 0): 0 the view (read), 1 colour, 2 motion, 3 depth, 4 ids (written, tightly packed rows).
// Each invocation writes its own texel and reads nothing that another one writes, so that the result is deterministic.
// Loop bounds are loaded before their loops: with a load in a loop's condition, the validation layer's GPU-assisted
// instrumentation (1.3.239) emits a module that drivers refuse.
#version 460
#extension GL_GOOGLE_include_directive : require
#include "maths.glsl"

layout(local_size_x = 8, local_size_y = 8) in;

const uint SPHERE = 0u;
const uint PANEL = 1u;
const uint GROUND = 2u;
const uint RIDGE = 3u;
const uint SKY = 4u;
const uint CARD = 5u;
const uint SHEET = 6u;   // the first of the forms of a sheet
const uint BARS = 7u;
const uint LEAVES = 8u;
const uint BLADES = 9u;

const uint MAX_OBJECTS = 24u;
const uint MAX_LAYERS = 192u;

const uint HDR_F16X4 = 0u;
const uint MOTION_F16X2 = 0u;
const uint MOTION_F32X2 = 1u;
const uint WRITES_MOTION = 1u;
const uint WRITES_DEPTH = 2u;
const uint WRITES_IDS = 4u;

const float CUTOFF_PER_PX = 0.25;
const float REACH_PX = 14.0;
const float LEAST_COVERAGE = 1e-12;
const float OPAQUE = 1e-10;
const float LEAF_SOFTNESS = 0.05;
const uint PROPELLER_BLADES = 3u;
const float SHADOW_EDGE_M = 0.12;
const float SHADOW_FOOTPRINT_M = 0.3;
const float F16_MAX = 65504.0;
const uint INFINITE_DEPTH = 0x7F800000u;

struct Layer {
    vec4 wave0;      // frequency per unit, phase in turns
    vec4 wave1;
    vec4 amplitude;  // log R, G, B; edge in radians, negative for a sinusoid
};

struct Object {
    uvec4 kind;       // shape, first layer, layers, instance id
    vec4 origin;      // position, metres; radius, plane offset, height or elevation
    vec4 normal;      // panel and sheet; level of leaves, radius of a propeller's hub
    vec4 axis0;       // panel: unit vector, half extent in metres; blades: the first one's, half width
    vec4 axis1;       // panel; blades: length
    vec4 borders[4];  // panel's borders, ground's horizon (0), waves of a ridge, of bars (0) and leaves
    vec4 heights;     // amplitudes of a ridge and of leaves, share of bars (0)
    vec4 base;        // log R, G, B
    vec4 gradient;    // log R, G, B towards the zenith
    vec4 finish;      // ambient, sun, lamp, emission
    vec4 gloss;       // haze, highlight, its sharpness, unused
    vec4 delta[3];    // rows of (motion to the previous frame less identity), shift
};

layout(std430, binding = 0) readonly buffer ViewBuffer {
    uvec4 size;        // width, height, objects, solids
    uvec4 formats;     // colour, motion, WRITES_*, unused
    vec4 camera;       // focal length in px, its inverse, image centre
    vec4 up;
    vec4 sun_direction;
    vec4 lamp_m;
    vec4 sun_rgb;
    vec4 sky_rgb;
    vec4 ground_rgb;
    vec4 halo;         // R, G, B, sharpness
    vec4 disc;
    vec4 haze;         // R, G, B, per metre
    vec4 lamp_rgb;
    vec4 card_lamp;    // centre in px, 1 / radius^2, level
    vec4 card_rgb;     // R, G, B, exposure of the whole scene
    Object objects[MAX_OBJECTS];
    Layer layers[MAX_LAYERS];
} view;

layout(std430, binding = 1) writeonly buffer Colour { uint colour_words[]; };
layout(std430, binding = 2) writeonly buffer MotionOut { uint motion_words[]; };
layout(std430, binding = 3) writeonly buffer DepthOut { uint depth_words[]; };
layout(std430, binding = 4) writeonly buffer IdsOut { uint id_words[]; };

struct Ray {
    vec3 direction;
    float per_px;
    vec3 position_px;
};

struct Hit {
    float coverage;
    float clear;      // 1 - coverage, computed without cancellation
    vec3 position;
    vec3 normal;
    vec3 dx;
    vec3 dy;
};

float coverage(float distance_px) {
    return 1.0 / (1.0 + exp_exact(-2.0 * distance_px));
}

void cover(inout Hit hit, float distance_px) {
    hit.coverage = coverage(distance_px);
    hit.clear = coverage(-distance_px);
}

// Covers the hit by another border as well.
void cut_off(inout Hit hit, float distance_px) {
    hit.clear += hit.coverage * coverage(-distance_px);
    hit.coverage *= coverage(distance_px);
}

float wave_value(vec4 wave, float edge_rad, vec3 position, vec3 dx, vec3 dy) {
    float sine = sin_turns(dot(wave.xyz, position) + wave.w);
    float fx = dot(wave.xyz, dx);
    float fy = dot(wave.xyz, dy);
    float frequency2 = fx * fx + fy * fy;
    float fade = max(1.0 - frequency2 / (CUTOFF_PER_PX * CUTOFF_PER_PX), 0.0);
    float shaped = sine;
    if (edge_rad >= 0.0)
        shaped = tanh_exact(sine / sqrt(edge_rad * edge_rad + TAU * TAU * frequency2));
    return shaped * fade * fade;
}

void flat_hit(inout Hit hit, float slope, Ray ray) {
    float step_m = hit.position.z * ray.per_px;
    hit.dx = (vec3(1.0, 0.0, 0.0) - ray.direction * (hit.normal.x / slope)) * step_m;
    hit.dy = (vec3(0.0, 1.0, 0.0) - ray.direction * (hit.normal.y / slope)) * step_m;
}

void far_hit(inout Hit hit, Ray ray) {
    float ray_length = length(ray.direction);
    vec3 unit = ray.direction / ray_length;
    float step_m = ray.per_px / ray_length;
    hit.coverage = 1.0;
    hit.clear = 0.0;
    hit.position = unit;
    hit.normal = -unit;
    hit.dx = (vec3(1.0, 0.0, 0.0) - unit * unit.x) * step_m;
    hit.dy = (vec3(0.0, 1.0, 0.0) - unit * unit.y) * step_m;
}

bool hit_sphere(uint index, Ray ray, out Hit hit) {
    vec3 d = ray.direction;
    vec3 centre = view.objects[index].origin.xyz;
    float radius_m = view.objects[index].origin.w;
    float along = dot(centre, d);
    if (along <= 0.0)
        return false;
    float length2 = dot(d, d);
    float nearest = along / length2;
    vec3 offset = centre - d * nearest;
    float miss_m = length(offset);
    float direction_xy = length(offset.xy) / max(miss_m, 1e-12 * radius_m);
    float miss_per_px = nearest * ray.per_px * max(direction_xy, 0.5);
    float distance_px = (radius_m - miss_m) / miss_per_px;
    if (distance_px < -REACH_PX)
        return false;
    float chord2 = soft_positive((radius_m - miss_m) * (radius_m + miss_m), radius_m * miss_per_px);
    hit.position = d * (nearest - sqrt(chord2 / length2));
    hit.normal = normalize(hit.position - centre);
    cover(hit, distance_px);
    flat_hit(hit, dot(hit.normal, d), ray);
    return true;
}

bool hit_panel(uint index, Ray ray, out Hit hit) {
    hit.coverage = 1.0;
    hit.clear = 0.0;
    for (uint i = 0u; i < 4u; ++i) {
        float distance_px = dot(view.objects[index].borders[i].xyz, ray.direction);
        if (distance_px < -REACH_PX)
            return false;
        cut_off(hit, distance_px);
    }
    hit.normal = view.objects[index].normal.xyz;
    float slope = min(dot(hit.normal, ray.direction), -1e-3);
    hit.position = ray.direction * (view.objects[index].origin.w / slope);
    flat_hit(hit, slope, ray);
    return true;
}

bool hit_ground(uint index, Ray ray, out Hit hit) {
    float distance_px = dot(view.objects[index].borders[0].xyz, ray.direction);
    if (distance_px < -REACH_PX)
        return false;
    vec3 up = view.up.xyz;
    float slope_per_px = length(up.xy) * ray.per_px;
    float slope = -soft_positive(-dot(up, ray.direction), 0.5 * slope_per_px);
    cover(hit, distance_px);
    hit.position = ray.direction * (-view.objects[index].origin.w / slope);
    hit.normal = up;
    flat_hit(hit, slope, ray);
    return true;
}

bool hit_ridge(uint index, Ray ray, out Hit hit) {
    far_hit(hit, ray);
    float height = view.objects[index].origin.w;
    for (uint i = 0u; i < 4u; ++i)
        height += view.objects[index].heights[i]
            * wave_value(view.objects[index].borders[i], -1.0, hit.position, hit.dx, hit.dy);
    float distance_px = (height - dot(hit.position, view.up.xyz)) * view.camera.x;
    cover(hit, distance_px);
    return distance_px >= -REACH_PX;
}

// Largest change of `direction . position` from a pixel to another one pixel away.
float per_px(vec3 direction, Hit hit) {
    return length(vec2(dot(direction, hit.dx), dot(direction, hit.dy)));
}

void cut_bars(inout Hit hit, uint index) {
    vec4 wave = view.objects[index].borders[0];
    float half_width = 0.5 * view.objects[index].heights.x;
    float turns = dot(wave.xyz, hit.position) + wave.w;
    float off = turns - round(turns);
    float turns_per_px = per_px(wave.xyz, hit);
    cut_off(hit, (half_width - off) / turns_per_px);
    cut_off(hit, (half_width + off) / turns_per_px);
}

void cut_leaves(inout Hit hit, uint index) {
    float height = -view.objects[index].normal.w;
    vec2 gradient = vec2(0.0);
    float mean2 = 0.0;
    for (uint i = 0u; i < 4u; ++i) {
        vec4 wave = view.objects[index].borders[i];
        float amplitude = view.objects[index].heights[i];
        float turns = dot(wave.xyz, hit.position) + wave.w;
        height += amplitude * sin_turns(turns);
        vec2 frequency = vec2(dot(wave.xyz, hit.dx), dot(wave.xyz, hit.dy));
        float steepest = TAU * amplitude;
        gradient += steepest * sin_turns(turns + 0.25) * frequency;
        mean2 += 0.5 * steepest * steepest * dot(frequency, frequency);
    }
    cover(hit, height / sqrt(dot(gradient, gradient) + LEAF_SOFTNESS * mean2));
}

void cut_blades(inout Hit hit, uint index) {
    vec4 x_axis = view.objects[index].axis0;
    vec4 y_axis = view.objects[index].axis1;
    float hub_m = view.objects[index].normal.w;
    vec3 from_hub = hit.position - view.objects[index].origin.xyz;
    float radius_m = length(from_hub);
    vec3 radial = from_hub / max(radius_m, 1e-12 * hub_m);
    Hit propeller = hit;
    cover(propeller, (hub_m - radius_m) / max(per_px(radial, hit), 1e-12));
    for (uint blade = 0u; blade < PROPELLER_BLADES; ++blade) {
        float turns = float(blade) / float(PROPELLER_BLADES);
        float sine = sin_turns(turns);
        float cosine = sin_turns(turns + 0.25);
        vec3 along = x_axis.xyz * cosine + y_axis.xyz * sine;
        vec3 across = y_axis.xyz * cosine - x_axis.xyz * sine;
        float off_m = dot(across, from_hub);
        float reach_m = dot(along, from_hub);
        float across_per_px = per_px(across, hit);
        float along_per_px = per_px(along, hit);
        Hit one = hit;
        cut_off(one, (x_axis.w - off_m) / across_per_px);
        cut_off(one, (x_axis.w + off_m) / across_per_px);
        cut_off(one, reach_m / along_per_px);
        cut_off(one, (y_axis.w - reach_m) / along_per_px);
        propeller.coverage += propeller.clear * one.coverage;
        propeller.clear *= one.clear;
    }
    hit = propeller;
}

// `cut.rs` evaluates the same forms in f64.
bool hit_sheet(uint index, uint shape, Ray ray, out Hit hit) {
    hit.coverage = 1.0;
    hit.clear = 0.0;
    hit.normal = view.objects[index].normal.xyz;
    float slope = min(dot(hit.normal, ray.direction), -1e-3);
    hit.position = ray.direction * (view.objects[index].origin.w / slope);
    flat_hit(hit, slope, ray);
    if (shape == BARS)
        cut_bars(hit, index);
    else if (shape == LEAVES)
        cut_leaves(hit, index);
    else if (shape == BLADES)
        cut_blades(hit, index);
    return hit.coverage >= LEAST_COVERAGE;
}

bool hit_object(uint index, Ray ray, out Hit hit) {
    uint shape = view.objects[index].kind.x;
    if (shape >= SHEET)
        return hit_sheet(index, shape, ray, hit);
    if (shape == SPHERE)
        return hit_sphere(index, ray, hit);
    if (shape == PANEL)
        return hit_panel(index, ray, hit);
    if (shape == GROUND)
        return hit_ground(index, ray, hit);
    if (shape == RIDGE)
        return hit_ridge(index, ray, hit);
    if (shape == SKY) {
        far_hit(hit, ray);
        return true;
    }
    hit.coverage = 1.0;
    hit.clear = 0.0;
    hit.position = ray.position_px;
    hit.normal = vec3(0.0, 0.0, -1.0);
    hit.dx = vec3(1.0, 0.0, 0.0);
    hit.dy = vec3(0.0, 1.0, 0.0);
    return true;
}

float wrapped(float cosine) {
    float x = max((cosine + 0.3) / 1.3, 0.0);
    return x * x;
}

// Share of the sun's light that reaches a point.
float shadow(uint receiver, Hit hit) {
    float footprint2 = dot(hit.dx, hit.dx) + dot(hit.dy, hit.dy);
    float capped2 = footprint2 / (1.0 + footprint2 / (SHADOW_FOOTPRINT_M * SHADOW_FOOTPRINT_M));
    float edge_m = sqrt(SHADOW_EDGE_M * SHADOW_EDGE_M + capped2);
    vec3 sun = view.sun_direction.xyz;
    float share = 1.0;
    uint solids = view.size.w;
    for (uint index = 0u; index < solids; ++index) {
        if (index == receiver || view.objects[index].finish.w > 0.0)
            continue;
        vec3 to_object;
        float hidden;
        if (view.objects[index].kind.x == SPHERE) {
            to_object = view.objects[index].origin.xyz - hit.position;
            float along = dot(to_object, sun);
            float miss = length(to_object - sun * along);
            hidden = coverage((view.objects[index].origin.w - miss) / edge_m) * coverage(along / edge_m);
        } else {
            to_object = view.objects[index].origin.xyz - hit.position;
            vec3 normal = view.objects[index].normal.xyz;
            float slope = dot(normal, sun);
            float along = dot(normal, to_object) * (slope / (slope * slope + 1e-4));
            vec3 landing = sun * along - to_object;
            vec4 axis0 = view.objects[index].axis0;
            vec4 axis1 = view.objects[index].axis1;
            hidden = coverage(along / edge_m) * coverage((axis0.w - abs(dot(landing, axis0.xyz))) / edge_m)
                * coverage((axis1.w - abs(dot(landing, axis1.xyz))) / edge_m);
        }
        share *= 1.0 - hidden;
    }
    return share;
}

vec3 exp3(vec3 x) {
    return vec3(exp_exact(x.x), exp_exact(x.y), exp_exact(x.z));
}

vec3 colour(uint index, Hit hit) {
    uvec4 kind = view.objects[index].kind;
    vec3 logarithm = view.objects[index].base.rgb;
    uint past_layers = kind.y + kind.z;
    for (uint i = kind.y; i < past_layers; ++i) {
        vec4 amplitude = view.layers[i].amplitude;
        float value = wave_value(view.layers[i].wave0, amplitude.w, hit.position, hit.dx, hit.dy)
            * wave_value(view.layers[i].wave1, amplitude.w, hit.position, hit.dx, hit.dy);
        logarithm += amplitude.rgb * value;
    }
    vec3 p = hit.position;
    vec3 sun = view.sun_direction.xyz;
    if (kind.x == SKY) {
        float rise = dot(p, view.up.xyz);
        logarithm += view.objects[index].gradient.rgb * (rise / (abs(rise) + 0.25));
    }
    vec3 texture_rgb = exp3(logarithm);
    if (kind.x == CARD) {
        vec2 away = p.xy - view.card_lamp.xy;
        float fall = 1.0 / (1.0 + dot(away, away) * view.card_lamp.z);
        return texture_rgb * (vec3(1.0) + view.card_rgb.rgb * (view.card_lamp.w * fall * fall));
    }
    if (kind.x == SKY) {
        vec3 off = p - sun;
        float away2 = 0.5 * dot(off, off);
        return texture_rgb + view.halo.rgb * exp_exact(-view.halo.w * away2)
            + view.disc.rgb * exp_exact(-view.disc.w * away2);
    }
    vec4 finish = view.objects[index].finish;
    vec4 gloss = view.objects[index].gloss;
    if (kind.x == RIDGE)
        return texture_rgb;
    if (finish.w > 0.0)
        return texture_rgb * finish.w;
    vec3 n = hit.normal;
    vec3 ambient = mix(view.ground_rgb.rgb, view.sky_rgb.rgb, 0.5 + 0.5 * dot(n, view.up.xyz));
    float lit_share = shadow(index, hit);
    vec3 to_lamp = view.lamp_m.xyz - p;
    float lamp_distance2 = dot(to_lamp, to_lamp);
    float lamp = wrapped(dot(n, to_lamp) / sqrt(lamp_distance2)) / (lamp_distance2 + 0.25);
    vec3 irradiance = ambient * finish.x + view.sun_rgb.rgb * (finish.y * lit_share * wrapped(dot(n, sun)))
        + view.lamp_rgb.rgb * (finish.z * lamp);
    float distance_m = length(p);
    vec3 half_way = normalize(sun - p / distance_m);
    vec3 off = n - half_way;
    float highlight = gloss.y * lit_share * exp_exact(-gloss.z * (0.5 * dot(off, off)));
    vec3 lit = texture_rgb * irradiance + view.sun_rgb.rgb * highlight;
    return mix(view.haze.rgb, lit, exp_exact(-distance_m * gloss.x * view.haze.w));
}

// Position in the previous frame less the position here, pixels, y down.
vec2 motion(uint index, vec3 p) {
    vec4 at = vec4(p, 1.0);
    vec3 delta = vec3(dot(view.objects[index].delta[0], at), dot(view.objects[index].delta[1], at),
        dot(view.objects[index].delta[2], at));
    if (view.objects[index].kind.x == CARD)
        return delta.xy;
    return (delta.xy - p.xy / p.z * delta.z) * (view.camera.x / (p.z + delta.z));
}

void main() {
    uvec2 pixel = gl_GlobalInvocationID.xy;
    if (any(greaterThanEqual(pixel, view.size.xy)))
        return;
    vec2 from_centre = vec2(pixel) - view.camera.zw;
    Ray ray = Ray(vec3(from_centre * view.camera.y, 1.0), view.camera.y, vec3(from_centre, 1.0));
    vec3 radiance = vec3(0.0);
    float left = 1.0;
    bool found = false;
    uint seen = 0u;
    vec3 seen_at = vec3(0.0, 0.0, 1.0);
    uint objects = view.size.z;
    for (uint index = 0u; index < objects && left >= OPAQUE; ++index) {
        Hit hit;
        if (!hit_object(index, ray, hit))
            continue;
        radiance += colour(index, hit) * (left * hit.coverage);
        left *= hit.clear;
        if (!found && hit.coverage >= 0.5) {
            found = true;
            seen = index;
            seen_at = hit.position;
        }
    }
    radiance *= view.card_rgb.w;

    uint texel = pixel.y * view.size.x + pixel.x;
    if (view.formats.x == HDR_F16X4) {
        vec3 limited = min(radiance, vec3(F16_MAX));
        colour_words[2u * texel] = packHalf2x16(limited.rg);
        colour_words[2u * texel + 1u] = packHalf2x16(vec2(limited.b, 1.0));
    } else {
        colour_words[4u * texel] = floatBitsToUint(radiance.r);
        colour_words[4u * texel + 1u] = floatBitsToUint(radiance.g);
        colour_words[4u * texel + 2u] = floatBitsToUint(radiance.b);
        colour_words[4u * texel + 3u] = floatBitsToUint(1.0);
    }
    if ((view.formats.z & WRITES_MOTION) != 0u) {
        vec2 moved = motion(seen, seen_at);
        if (view.formats.y == MOTION_F16X2) {
            motion_words[texel] = packHalf2x16(moved);
        } else {
            uint stride = view.formats.y == MOTION_F32X2 ? 2u : 4u;
            motion_words[stride * texel] = floatBitsToUint(moved.x);
            motion_words[stride * texel + 1u] = floatBitsToUint(moved.y);
            if (stride == 4u) {
                motion_words[4u * texel + 2u] = 0u;
                motion_words[4u * texel + 3u] = 0u;
            }
        }
    }
    if ((view.formats.z & WRITES_DEPTH) != 0u) {
        uint shape = view.objects[seen].kind.x;
        bool far = shape == RIDGE || shape == SKY;
        depth_words[texel] = far ? INFINITE_DEPTH : floatBitsToUint(seen_at.z);
    }
    if ((view.formats.z & WRITES_IDS) != 0u)
        id_words[texel] = view.objects[seen].kind.w;
}
