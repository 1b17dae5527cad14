// The stretches of a physical pixel with noise: the noise that a signal meets, and the hazard of a noise event.

// Phase of the slower pole since a release beyond which the noise moves slowly.
const float SETTLED_PHASE = 2.5;
// Hazard of a stretch below which it does not matter when in it the noise has settled.
const float SMALL_HAZARD = 0.02;
// Largest exponent by which a hazard grows or falls within a stretch.
const float MOST_HAZARD_GROWTH = 6.0;

// What is known of the noise at a share of the part.
Law law_at(Camera cam, PixelState p, Walk w, float share) {
    const float t = fma(share, float(w.part.end - w.part.start), float(w.part.start));
    const float phase = max(fma(share, w.part.turned, p.phase), 0.0);
    return noise_law(
        p.noise, lerp(w.part.from_sigma, w.drive.sigma, share), phase, second_phase(cam, p, w, t));
}

// A stretch: shares of the part and the watched level above the reference, nepers, at both ends.
struct Stretch {
    float start;
    float end;
    float from;
    float to;
};

// Share of the part at which a stretch crosses `level`. The straight line's crossing is made better once, on the part's
// cubic and with the law of the noise.
float noisy_crossing(Camera cam, Stretch stretch, float level, PixelState p, Walk w) {
    const float straight = clamp((level - stretch.from) / (stretch.to - stretch.from), 0.0, 1.0);
    const float at = lerp(stretch.start, stretch.end, straight);
    const Law law = law_at(cam, p, w, at);
    const float noise = fma(law.deviation, w.deviate, law.mean);
    const float there = above_at(w.part, p.reference, at) + noise;
    const bool is_before = (there < level) == (stretch.from < level);
    const vec2 from = is_before ? vec2(at, there) : vec2(stretch.start, stretch.from);
    const vec2 to = is_before ? vec2(stretch.end, stretch.to) : vec2(at, there);
    return lerp(from.x, to.x, from.y == to.y ? 1.0 : clamp((level - from.y) / (to.y - from.y), 0.0, 1.0));
}

// Hazards in a stretch, and the exponent by which that of the nearer threshold grows over it.
struct Hazard {
    float off;
    float on;
    float growth;
};

// Hazards from the share `start` to `end` of the part, over which the mean of the noise goes by `mean_rise`. They are those
// at the middle, where `law` holds; the nearer threshold's grows or falls exponentially from there.
Hazard stretch_hazard(Camera cam, Law law, float start, float end, float mean_rise, PixelState p, Walk w) {
    const float middle = 0.5 * (start + end);
    if (!(end > start) || law.deviation <= 0.0) {
        return Hazard(0.0, 0.0, 0.0);
    }
    const float per_deviation = 1.0 / law.deviation;
    const float above = above_at(w.part, p.reference, middle) + law.mean;
    const float off = (nepers(p.off_q24) + above) * per_deviation;
    const float on = (nepers(p.on_q24) - above) * per_deviation;
    const float nearer = min(off, on);
    if (nearer > FAR_DISTANCE + 1.0) {
        return Hazard(0.0, 0.0, 0.0);
    }
    const float bowed = bow_at(w.part, end) - bow_at(w.part, start);
    const float rise = (fma(nepers(w.part.to - w.part.from), end - start, bowed) + mean_rise) * per_deviation;
    const float nearing = on < off ? rise : -rise;
    // e^(-b^2/2) where b falls by `nearing`, over its value in the middle.
    const float growth = clamp(max(nearer, 0.7) * nearing, -MOST_HAZARD_GROWTH, MOST_HAZARD_GROWTH);
    const float half_squared = 0.25 * growth * growth;
    const float grown = fma(
        half_squared, fma(half_squared, fma(half_squared, 1.0 / 5040.0, 1.0 / 120.0), 1.0 / 6.0), 1.0);
    const float duration_s = 1e-9 * (float(w.part.end - w.part.start) * (end - start));
    const Rates rates = noise_rates(w.drive.first_per_s, physicals[cam.slot].second_per_s);
    const float near = duration_s * grown * hazard_per_s(nearer, rates);
    const float further = max(off, on);
    const float far = further < FAR_DISTANCE ? duration_s * hazard_per_s(further, rates) : 0.0;
    return on < off ? Hazard(far, near, growth) : Hazard(near, far, growth);
}

// Share of a stretch's length at which the clock has run out, which it does within it.
float spent_share(Hazard hazard, float clock) {
    const float spent = clock / (hazard.off + hazard.on);
    return abs(hazard.growth) < 0.01 ? spent : log(fma(spent, exp(hazard.growth) - 1.0, 1.0)) / hazard.growth;
}

// Hazard that is left until the clock has run out.
float clock_left(uint clock) {
    return float(clock) * (1.0 / float(1u << HAZARD_FRACTION_BITS));
}

// Spends hazard that the clock has.
uint spend(uint clock, float hazard) {
    return clock - min(clock, uint(roundEven(hazard * float(1u << HAZARD_FRACTION_BITS))));
}

// Time at a share of a part.
uint time_at(Part part, float share) {
    return time_in_substep(part.start, part.end, share, 1.0);
}

// Slope of the noise at an event at a share of the part, in its standard deviations. It is `noise` there; `word` is the
// renewal's.
float noise_slope(Camera cam, bool on, float share, float noise, uint word, PixelState p, Walk w) {
    const float outwards = on ? 1.0 : -1.0;
    const float sigma = lerp(w.part.from_sigma, w.drive.sigma, share);
    const float t = fma(share, float(w.part.end - w.part.start), float(w.part.start));
    const float phase = max(fma(share, w.part.turned, p.phase), 0.0);
    const float per_sigma = outwards / max(sigma, 1e-20);
    const SlopeLaw law =
        slope_law(p.noise * per_sigma, noise * per_sigma, phase, second_phase(cam, p, w, t));
    const float deviation_per_s = sqrt(w.drive.first_per_s * physicals[cam.slot].second_per_s);
    const float light = slope_at(w.part, share) * (1e9 * w.part.per_ns) * per_sigma / max(deviation_per_s, 1e-9);
    return outwards * slope_at_event(law, light, sqrt(2.0 * exponential_of(word)));
}

// Watches the pixel over the next stretch of the part, up to an event if there is one. Returns whether the part is over.
bool watch_noisy(Camera cam, uint pixel, inout PixelState p, inout Walk w) {
    const float on_log = nepers(p.on_q24);
    const float off_log = nepers(p.off_q24);
    Stretch stretch;
    stretch.start = share_of(w.part, w.now);
    uint until = w.now < w.part.turn ? w.part.turn : w.part.end;
    // Noise moves fast after a release: until the slower pole has turned some times, a stretch in which anything may happen
    // is no longer than that.
    const float second_per_s = physicals[cam.slot].second_per_s;
    const float phase = fma(stretch.start, w.part.turned, p.phase);
    bool hurries = false;
    if (min(phase, second_phase(cam, p, w, float(w.now))) < SETTLED_PHASE) {
        const float longest_ns = SETTLED_PHASE * 1e9 / min(w.drive.first_per_s, second_per_s);
        const bool is_long = longest_ns < float(until - w.now);
        hurries = is_long && w.hurries;
        until = is_long && !hurries ? w.now + max(uint(longest_ns), 1u) : until;
    }
    stretch.end = until == w.part.end ? 1.0 : share_of(w.part, until);
    const Law law = law_at(cam, p, w, stretch.end);
    const float noise = fma(law.deviation, w.deviate, law.mean);
    stretch.from = above_at(w.part, p.reference, stretch.start) + w.noise;
    stretch.to = above_at(w.part, p.reference, stretch.end) + noise;
    // After a change of parameters the level may lie beyond a threshold from the start.
    const float first = cam.no_skip != 0u && w.now <= 1u ? stretch.from : 0.0;
    const bool starts_above = first >= on_log;
    const bool starts_beyond = starts_above || -first >= off_log;
    const bool rises = starts_beyond ? starts_above : stretch.to >= on_log;
    const bool falls = starts_beyond ? !starts_above : -stretch.to >= off_log;
    float signal = LONGEST_TURN;
    bool crosses = false;
    if (rises || falls) {
        const float level = rises ? on_log : -off_log;
        crosses = !starts_beyond && (rises ? stretch.from < level : stretch.from > level);
        signal = crosses ? noisy_crossing(cam, stretch, level, p, w) : stretch.start;
    }
    const float end = min(signal, stretch.end);
    const float watched = stretch.end > stretch.start
        ? (end - stretch.start) / (stretch.end - stretch.start)
        : 0.0;
    const Law middle_law = law_at(cam, p, w, 0.5 * (stretch.start + end));
    const Hazard hazard =
        stretch_hazard(cam, middle_law, stretch.start, end, watched * (law.mean - w.mean), p, w);
    const float clock = clock_left(p.clock);
    const bool runs_out = clock < hazard.off + hazard.on;
    if (hurries && (rises || falls || runs_out || hazard.off + hazard.on > SMALL_HAZARD)) {
        w.hurries = false;
        return false;
    }
    if (!runs_out && !rises && !falls) {
        p.clock = spend(p.clock, hazard.off + hazard.on);
        w.now = until;
        w.noise = noise;
        w.mean = law.mean;
        return until == w.part.end;
    }
    const float share =
        runs_out ? lerp(stretch.start, end, clamp(spent_share(hazard, clock), 0.0, 1.0)) : end;
    // The first instant of a sub-step belongs to the one before.
    const uint at = max(time_at(w.part, share), w.now);
    const bool holds = EFFECT_REFRACTORY && cam.refractory_ns != 0u;
    uvec2 words = uvec2(0u);
    if (runs_out || holds) {
        words = polarity_words(cam, pixel, p, w);
    }
    bool on = rises;
    if (runs_out) {
        on = float(words.x) * (1.0 / 4294967296.0) * (hazard.off + hazard.on) < hazard.on;
    }
    // The noise is what lifts the output to the threshold, unless the level lies beyond it from the start.
    const float lifted = (on ? on_log : -off_log) - above_at(w.part, p.reference, share);
    const float met = runs_out || crosses ? lifted : w.noise;
    const float slope = holds ? noise_slope(cam, on, share, met, words.y, p, w) : 0.0;
    fire(cam, at, on, met, slope, p, w);
    return false;
}
