// What a physical pixel's event and its release do, and the draws that they need.

// Draws of the coming renewals, the one after `k` others at `k % DRAWN_AHEAD`. Before the walk all pixels of a subgroup make
// their first ones together. Later a pixel makes one when it needs it; the software driver would make draws that stand in a
// loop in each round: there, where WALKS_SUSPEND, the walk ends until the kernel has called `make_draw`.
const uint DRAWN_AHEAD = WALKS_SUSPEND ? 1u : 8u;
Draws drawn[DRAWN_AHEAD];
bool draws_missing;

bool needs_draw() {
    return WALKS_SUSPEND && draws_missing;
}

// Makes the draws of one more renewal.
void make_draw(Camera cam, uint pixel, PixelState p, inout Walk w) {
    const uint events = p.events + w.first_renewal + w.drawn;
    const uvec4 words = draw(cam, pixel, STREAM_CLOCK, events);
    drawn[w.drawn % DRAWN_AHEAD] = Draws(
        EFFECT_REFRACTORY ? normal_from_words(draw(cam, pixel, STREAM_RELEASE, events)) : 0.0,
        normal_from_words(draw(cam, pixel, STREAM_THRESHOLD, events)), exponential_q27(words.x), words.yz);
    w.drawn += 1u;
    draws_missing = false;
}

// Words for the polarity of a noise event and for the noise's slope at an event in the present renewal.
uvec2 polarity_words(Camera cam, uint pixel, PixelState p, Walk w) {
    if (w.ordinal >= w.first_renewal) {
        return drawn[(w.ordinal - w.first_renewal) % DRAWN_AHEAD].words;
    }
    return WALKS_SUSPEND ? w.words : draw(cam, pixel, STREAM_CLOCK, p.events).yz;
}

// Begins a renewal with these draws.
void begin_renewal(Draws draws, inout PixelState p, inout Walk w) {
    p.clock = draws.clock;
    w.deviate = draws.deviate;
    w.renews = false;
    w.hurries = true;
}

// Phase of the second stage at time t since the last release or, while the pixel is held, its event.
float second_phase(Camera cam, PixelState p, Walk w, float t) {
    const int since_ns = w.is_held ? p.release_ns - int(cam.refractory_ns) : p.release_ns;
    return max(physicals[cam.slot].second_per_s * ((t - float(since_ns)) * 1e-9), 0.0);
}

// Books an event at time t, at which the noise is `noise`: begins the hold or, without a refractory period, the next
// renewal. `slope` is that of the noise, in its standard deviations.
void fire(Camera cam, uint t, bool on, float noise, float slope, inout PixelState p, inout Walk w) {
    // Only the stamp waits for the end of the sub-step.
    emit(AT_SAMPLE ? w.end : t, on, w.ordinal);
    w.ordinal += 1u;
    w.now = t;
    p.noise = noise;
    w.noise = noise;
    w.mean = noise;
    p.phase = -share_of(w.part, t) * w.part.turned;
    if (EFFECT_REFRACTORY && cam.refractory_ns != 0u) {
        w.is_held = true;
        p.release_ns = int(t + cam.refractory_ns);
        p.clock = floatBitsToUint(slope);
    } else {
        p.release_ns = int(t);
        p.reference += on ? p.on_q24 : -p.off_q24;
        w.renews = true;
    }
    p.silent = w.ordinal >= MOST_PIXEL_EVENTS;
}

// Ends the hold at time t: the reference is what the pixel shows, with the noise of the moment. `fresh` is what is new in
// that, a normal deviate.
void release(Camera cam, uint t, float fresh, inout PixelState p, inout Walk w) {
    float noise = 0.0;
    const float share = share_of(w.part, t);
    if (EFFECT_SHOT) {
        const float phase = max(fma(share, w.part.turned, p.phase), 0.0);
        const float second = second_phase(cam, p, w, float(t));
        const float sigma = lerp(w.part.from_sigma, w.drive.sigma, share);
        const float slope = uintBitsToFloat(p.clock);
        const Memory memory = memory_after(phase, second);
        const float kept = memory.value;
        const float unknown = sqrt(max(1.0 - kept * kept - memory.slope * memory.slope, 0.0));
        noise = kept * p.noise + sigma * (memory.slope * slope + unknown * fresh);
    }
    p.noise = noise;
    w.noise = noise;
    w.mean = noise;
    p.reference = EFFECT_SHOT
        ? p.reference + to_q24(above_at(w.part, p.reference, share) + noise)
        : output_at(w.part, t);
    w.is_held = false;
    p.release_ns = int(t);
    w.now = t;
    p.phase = -share * w.part.turned;
}

// If the pixel is held, ends the hold as soon as it is over; begins the renewal that is due. Returns whether the pixel can
// be watched: not while it is held, nor while draws are missing.
bool awaken(Camera cam, uint pixel, inout PixelState p, inout Walk w) {
    if (!w.is_held && !(EFFECT_SHOT && w.renews)) {
        return true;
    }
    if (w.is_held && p.release_ns > int(w.part.end)) {
        return false;
    }
    Draws draws;
    if (EFFECT_SHOT) {
        const uint renewal = w.ordinal - w.first_renewal;
        if (renewal == w.drawn) {
            if (WALKS_SUSPEND) {
                draws_missing = true;
                return false;
            }
            make_draw(cam, pixel, p, w);
        }
        draws = drawn[renewal % DRAWN_AHEAD];
    }
    if (w.is_held) {
        release(cam, max(uint(p.release_ns), w.part.start), draws.fresh, p, w);
    }
    if (EFFECT_SHOT) {
        begin_renewal(draws, p, w);
    }
    return true;
}
