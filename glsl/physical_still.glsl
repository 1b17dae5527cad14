// Settled physical pixels in still light. The photoreceptor stays as it is and its noise is forgotten, so that a walk would
// be one part of one stretch, a straight line by the leak. If nothing happens in it, the pixel passes it here, with the bits
// of the walk: every formula is the walk's, without the terms that are exactly 0.

// Distance of both stages from where they settle, up to which a pixel in still light is put there: half a unit of levels.
const float SETTLED_LOG = 0.5 / LOG_SCALE;

// Settles a pixel whose light has been still for an interval, as soon as that changes no level.
void settle(inout PixelState p) {
    if (max(abs(p.excess), abs(p.lag)) < SETTLED_LOG) {
        p.excess = 0.0;
        p.lag = 0.0;
    }
}

// Takes a pixel over an interval with this level (as it is in the planes) throughout, if it is settled and sends nothing.
// Returns whether it does; if not, nothing has changed.
bool pass_interval(Camera cam, uint pixel, int level, inout PixelState p) {
    // After a change of parameters the level may lie beyond a threshold.
    if ((floatBitsToUint(p.excess) | floatBitsToUint(p.lag)) != 0u || p.release_ns > 0 || cam.no_skip != 0u) {
        return false;
    }
    Walk w = walk_at_start(cam, level, p);
    if (EFFECT_SHOT && min(p.phase, second_phase(cam, p, w, 0.0)) <= FORGOTTEN_PHASE) {
        return false;
    }
    PixelState after = p;
    const float span_ns = float(cam.interval_ns);
    const float duration_s = span_ns * 1e-9;
    const float charge = min(w.drive.per_s * duration_s, MOST_CHARGE);
    w.part.end = cam.interval_ns;
    w.part.per_ns = 1.0 / span_ns;
    w.part.turn = cam.interval_ns;
    w.part.from = w.to_level;
    w.part.bow = vec2(0.0);
    w.part.turns = vec2(0.0);
    w.part.from_sigma = w.drive.sigma;
    w.part.turned = charge;
    w.part.leaked = EFFECT_LEAK ? leak(cam, duration_s, charge, w.dark_leak, after) : 0;
    w.part.to = w.part.from + w.part.leaked;
    if (EFFECT_SHOT) {
        const float deviate = normal_from_words(draw(cam, pixel, STREAM_THRESHOLD, p.events));
        const float above = above_at(w.part, p.reference, 1.0) + w.drive.sigma * deviate;
        if (above >= nepers(p.on_q24) || -above >= nepers(p.off_q24)) {
            return false;
        }
        const Hazard hazard = stretch_hazard(cam, Law(0.0, w.drive.sigma), 0.0, 1.0, 0.0, p, w);
        if (clock_left(p.clock) < hazard.off + hazard.on) {
            return false;
        }
        after.clock = spend(p.clock, hazard.off + hazard.on);
    } else {
        const int above = output_at(w.part, w.part.end) - p.reference;
        if (above >= p.on_q24 || -above >= p.off_q24) {
            return false;
        }
    }
    end_part(w.part, after);
    after.release_ns = release_after(p.release_ns, w.part.end);
    after.passed = true;
    p = after;
    return true;
}
