// What a physical pixel's event and its release do, and the draws that they need.

// A walk makes draws where it needs them. The software driver would make those that stand in a loop in each round: there,
// where WALKS_SUSPEND, they are made before the walk for its first renewal, and for another one the walk ends until the
// kernel has called `make_draw`.
bool draws_missing;

bool needs_draw() {
    return WALKS_SUSPEND && draws_missing;
}

// Makes the draws of the next renewal, which begins after `events` events.
Draws draw_renewal(Camera cam, uint pixel, uint events) {
    const uvec4 words = draw(cam, pixel, STREAM_CLOCK, events);
    return Draws(
        EFFECT_REFRACTORY ? normal_from_words(draw(cam, pixel, STREAM_RELEASE, events)) : 0.0,
        normal_from_words(draw(cam, pixel, STREAM_THRESHOLD, events)), exponential_q27(words.x), words.yz);
}

void make_draw(Camera cam, uint pixel, inout PixelState p, inout Walk w) {
    w.next = draw_renewal(cam, pixel, p.events + w.ordinal);
    w.has_next = true;
    draws_missing = false;
}

// Begins a renewal with these draws.
void begin_renewal(Draws draws, inout PixelState p, inout Walk w) {
    p.clock = draws.clock;
    w.deviate = draws.deviate;
    w.words = draws.words;
    w.has_next = false;
    w.renews = false;
    w.hurries = true;
}

// Phase of the second stage at time t since the last release or, while the pixel is held, its event.
float second_phase(Camera cam, PixelState p, Walk w, float t) {
    const int since_ns = w.is_held ? p.release_ns - int(cam.refractory_ns) : p.release_ns;
    return max(physicals[cam.slot].second_per_s * ((t - float(since_ns)) * 1e-9), 0.0);
}

// Books an event at time t, at which the noise is `noise`: begins the hold or, without a refractory period, the next
// renewal. `slope` is 0 for a signal.
void fire(Camera cam, uint t, bool on, float noise, float slope, inout PixelState p, inout Walk w) {
    const uint at = AT_SAMPLE ? w.end : t;
    emit(at, on, w.ordinal);
    w.ordinal += 1u;
    w.now = t;
    p.noise = noise;
    w.noise = noise;
    p.phase = -share_of(w.part, t) * w.part.turned;
    if (EFFECT_REFRACTORY && cam.refractory_ns != 0u) {
        w.is_held = true;
        p.release_ns = int(at + cam.refractory_ns);
        p.clock = floatBitsToUint(slope);
    } else {
        p.release_ns = int(t);
        p.reference += on ? p.on_q24 : -p.off_q24;
        w.renews = true;
    }
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
        const float kept = min(correlation(phase, second), 1.0);
        const float turned = slope == 0.0 ? 0.0 : slope_correlation(phase, second);
        const float unknown = sqrt(max(1.0 - kept * kept - turned * turned, 0.0));
        noise = kept * p.noise + sigma * (turned * slope + unknown * fresh);
    }
    p.noise = noise;
    w.noise = noise;
    p.reference = output_at(w.part, t) + to_q24(noise);
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
    if (EFFECT_SHOT && WALKS_SUSPEND) {
        if (!w.has_next) {
            draws_missing = true;
            return false;
        }
        draws = w.next;
    } else if (EFFECT_SHOT) {
        draws = draw_renewal(cam, pixel, p.events + w.ordinal);
    }
    if (w.is_held) {
        release(cam, max(uint(p.release_ns), w.part.start), draws.fresh, p, w);
    }
    if (EFFECT_SHOT) {
        begin_renewal(draws, p, w);
    }
    return true;
}
