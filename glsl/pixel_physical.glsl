// The physical pixel's walk through one interval: photoreceptor, noise before the comparators, crossings, leak and
// refractory period. Its equations are in the model's `physical`; the oracle's `physical` solves them without
// approximation.
//
// The including kernel calls `begin_walk`, then `walk` over the interval's sub-steps, then `end_walk`. It provides
// `emit(at_ns, on, ordinal)`, `walks_on(ordinal)` (whether a walk goes on after `ordinal` events) and
// `level_of_substep(i)`.
//
// A sub-step is cut into parts (physical_part.glsl), over which the photoreceptor is taken at once. A part is cut into
// stretches, in which the watched level (output, leak and noise) only rises or only falls: those of a pixel without
// noise are in physical_quiet.glsl, those of one with noise in physical_noisy.glsl. An event or a release begins a new
// stretch. What needs no walk in still light is in physical_still.glsl.

// Level at the end of sub-step `i`, which counts from 1, as it is in the planes.
int level_of_substep(uint i);

// Largest phase that is kept.
const float MOST_PHASE = 40.0;
// Longest time since a release that is kept, nanoseconds.
const int LONGEST_NS = 1 << 30;

struct PixelState {
    int reference;
    // What the reference has above `reference`, in units of 2^-32 of its last bit.
    uint fraction;
    int on_q24;
    int off_q24;
    float dark_factor_log;
    float leak_factor_log;
    float excess;
    float lag;
    // Noise at the last release or, while the pixel is held, at its event; nepers.
    float noise;
    // Phase of the first stage since then.
    float phase;
    // Time of a release to come (above 0) or of the last one, from the interval's start.
    int release_ns;
    // Hazard left, Q27; while the pixel is held, the slope of the noise at its event, in its standard deviations.
    uint clock;
    uint events;
    // Whether it sends no more: it never had a valid colour, or has sent MOST_PIXEL_EVENTS in this interval.
    bool silent;
    // Whether it has passed the interval without a walk.
    bool passed;
};

PixelState load_pixel(Camera cam, uint pixel) {
    PixelState p;
    p.reference = int(load_state(cam, pixel, STATE_REFERENCE));
    p.fraction = EFFECT_LEAK ? load_state(cam, pixel, STATE_FRACTION) : 0u;
    p.on_q24 = EFFECT_MISMATCH ? int(load_state(cam, pixel, STATE_CONTRAST_ON)) : cam.contrast_on_q24;
    p.off_q24 = EFFECT_MISMATCH ? int(load_state(cam, pixel, STATE_CONTRAST_OFF)) : cam.contrast_off_q24;
    const vec2 factors = factors_log(cam, pixel);
    p.dark_factor_log = factors.x;
    p.leak_factor_log = factors.y;
    p.excess = uintBitsToFloat(load_state(cam, pixel, STATE_EXCESS));
    p.lag = uintBitsToFloat(load_state(cam, pixel, STATE_LAG));
    p.noise = uintBitsToFloat(load_state(cam, pixel, STATE_NOISE));
    p.phase = uintBitsToFloat(load_state(cam, pixel, STATE_PHASE));
    p.release_ns = int(load_state(cam, pixel, STATE_RELEASE));
    p.clock = load_state(cam, pixel, STATE_CLOCK);
    p.events = load_state(cam, pixel, STATE_EVENTS);
    p.silent = false;
    p.passed = false;
    return p;
}

// Makes an unarmed pixel emit nothing.
void silence(inout PixelState p, int level) {
    p.silent = true;
    p.release_ns = 0;
}

void store_pixel(Camera cam, uint pixel, PixelState p) {
    store_state(cam, pixel, STATE_REFERENCE, uint(p.reference));
    if (EFFECT_LEAK) {
        store_state(cam, pixel, STATE_FRACTION, p.fraction);
    }
    store_state(cam, pixel, STATE_PHASE, floatBitsToUint(p.phase));
    store_state(cam, pixel, STATE_RELEASE, uint(p.release_ns));
    if (EFFECT_SHOT) {
        store_state(cam, pixel, STATE_CLOCK, p.clock);
    }
    if (!p.passed) {
        store_state(cam, pixel, STATE_EXCESS, floatBitsToUint(p.excess));
        store_state(cam, pixel, STATE_LAG, floatBitsToUint(p.lag));
        store_state(cam, pixel, STATE_NOISE, floatBitsToUint(p.noise));
        store_state(cam, pixel, STATE_EVENTS, p.events);
    }
}

// What a renewal draws when it begins, and at the release before it.
struct Draws {
    float fresh;
    float deviate;
    uint clock;
    // For a noise event's polarity and the noise's slope at an event.
    uvec2 words;
};

#include "chord.glsl"
#include "physical_part.glsl"

// The state of a pixel's walk through an interval.
struct Walk {
    // The sub-step: its number, its end, what is left of a nanosecond there, the level at its end, and the parts of it so
    // far.
    uint substep;
    uint end;
    uint over;
    int to_level;
    uint parts;
    // The present part, the level at its end, whether it is over, and how far the pixel has been watched.
    Part part;
    int level;
    bool is_over;
    uint now;
    uint ordinal;
    // Whether the pixel is held until `release_ns`; else this is when it was released, or had its last event.
    bool is_held;
    // At the end of the present part.
    Drive drive;
    // Leak in the dark, Q24 per second.
    float dark_leak;
    // Noise of the moment that a signal meets and its mean, nepers, and its deviate.
    float noise;
    float mean;
    float deviate;
    // Whether stretches are as long as the part, although the noise moves fast.
    bool hurries;
    // Whether an event has ended the renewal and the next one has not begun; for WALKS_SUSPEND, words of the renewal that
    // the interval begins in.
    bool renews;
    uvec2 words;
    // Events before the first renewal that begins in this interval, and renewals whose draws are made from that on.
    uint first_renewal;
    uint drawn;
    // APS: level at the end of the sub-step as it is in the planes, and integral of the intensity.
    int raw;
    float exposed;
};

#include "physical_events.glsl"
#include "physical_quiet.glsl"
#include "physical_noisy.glsl"
#include "physical_walk.glsl"
#include "physical_still.glsl"
