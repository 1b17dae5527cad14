// The walk of a physical pixel: one loop over parts and stretches of all sub-steps, so that pixels of a subgroup wait for
// each other at the interval's end only.

// A walk at the interval's start, before any draw. `level` is that at the start, as it is in the planes.
Walk walk_at_start(Camera cam, int level, PixelState p) {
    Walk w;
    w.substep = 0u;
    w.end = 0u;
    w.over = 0u;
    w.to_level = own_level(cam, level, p.dark_factor_log);
    w.parts = 0u;
    w.part.start = 0u;
    w.part.end = 0u;
    w.part.leaked = 0;
    w.part.turned = 0.0;
    w.level = w.to_level;
    w.is_over = true;
    w.now = 0u;
    w.ordinal = 0u;
    w.is_held = EFFECT_REFRACTORY && p.release_ns > 0;
    w.drive.per_s = drive_per_s(cam, w.to_level);
    w.drive.behind = log_1p(p.excess);
    update_drive(cam, p.excess, w.drive);
    w.dark_leak = 0.0;
    if (EFFECT_LEAK) {
        w.dark_leak = dark_leak_q24_per_s(cam, vec2(p.dark_factor_log, p.leak_factor_log));
    }
    w.noise = 0.0;
    w.mean = 0.0;
    w.deviate = 0.0;
    w.hurries = true;
    w.renews = false;
    w.words = uvec2(0u);
    // A pixel that is not held has an event to come before its next renewal.
    w.first_renewal = w.is_held ? 0u : 1u;
    w.drawn = 0u;
    w.raw = level;
    w.exposed = 0.0;
    return w;
}

// Begins a walk of `n` sub-steps.
Walk begin_walk(Camera cam, uint pixel, uint n, int level, inout PixelState p) {
    Walk w = walk_at_start(cam, level, p);
    draws_missing = false;
    if (EFFECT_SHOT && !w.is_held && !p.silent) {
        w.words = WALKS_SUSPEND ? draw(cam, pixel, STREAM_CLOCK, p.events).yz : uvec2(0u);
        w.deviate = normal_from_words(draw(cam, pixel, STREAM_THRESHOLD, p.events));
        const Law law = noise_law(p.noise, w.drive.sigma, p.phase, second_phase(cam, p, w, 0.0));
        w.noise = fma(law.deviation, w.deviate, law.mean);
        w.mean = law.mean;
    }
    if (EFFECT_SHOT && !p.silent) {
        // More sub-steps are of more motion, and so of more events.
        const uint ahead = min(DRAWN_AHEAD, 1u + n / 4u);
        do {
            make_draw(cam, pixel, p, w);
        } while (w.drawn < ahead);
    }
    return w;
}

// Adds the exposure of a sub-step from `start` to `end`.
void expose(Camera cam, uint start, uint end, int from_raw, int to_raw, inout Walk w) {
    const uint first = max(start, cam.aps_start_ns);
    const uint last = min(end, cam.aps_end_ns);
    if (first < last) {
        const float mid = (0.5 * (float(first - start) + float(last - start))) / float(end - start);
        const vec2 seen = exp(vec2(nepers(from_raw), nepers(to_raw))) - cam.log_offset;
        w.exposed += lerp(seen.x, seen.y, mid) * float(last - first);
    }
}

// Begins the next of `n` sub-steps. Returns whether it has a length; one that has none joins the one after it.
bool begin_substep(Camera cam, uint n, PixelState p, inout Walk w) {
    const uint start = w.end;
    w.substep += 1u;
    w.end = next_end(substep_length(cam, n), start, w.over);
    if (w.end == start) {
        return false;
    }
    const int raw = level_of_substep(w.substep);
    if (EFFECT_APS) {
        expose(cam, start, w.end, w.raw, raw, w);
    }
    w.raw = raw;
    w.to_level = own_level(cam, raw, p.dark_factor_log);
    w.parts = 0u;
    return true;
}

// Begins the part that follows the present one.
void begin_part(Camera cam, inout PixelState p, inout Walk w) {
    const uint start = w.part.end;
    const int level = w.level;
    w.parts += 1u;
    uint end = w.end;
    bool settles = false;
    if (w.parts < MAX_PARTS) {
        end = part_end(cam, start, end, nepers(w.to_level - level), w.dark_leak, p, w.drive, settles);
    }
    const PixelState p_before = p;
    const Drive drive_before = w.drive;
    w.level = end == w.end ? w.to_level : level_at(level, w.to_level, start, w.end, end);
    w.part = next_part(cam, start, end, level, w.level, settles, w.dark_leak, p, w.drive);
    if (!EFFECT_SHOT && turn_decides(w.part, p)) {
        // The part ends there instead.
        p = p_before;
        w.drive = drive_before;
        const uint turn = w.part.turn;
        w.level = level_at(level, w.to_level, start, w.end, turn);
        w.part = next_part(cam, start, turn, level, w.level, settles, w.dark_leak, p, w.drive);
    }
    w.now = start;
}

// Takes the pixel to the end of a part that has been watched.
void end_part(Part part, inout PixelState p) {
    p.phase = clamp(p.phase + part.turned, 0.0, MOST_PHASE);
    p.reference -= part.leaked;
}

// Whether a walk of `n` sub-steps has not come to its end.
bool walk_goes_on(uint n, Walk w) {
    return !(w.is_over && w.part.end == w.end && w.substep == n) && walks_on(w.ordinal);
}

// Walks the pixel over its `n` sub-steps, or on to where draws are missing.
void walk(Camera cam, uint pixel, uint n, inout PixelState p, inout Walk w) {
    do {
        bool is_watched = !p.silent;
        if (w.is_over) {
            if (w.part.end == w.end) {
                is_watched = begin_substep(cam, n, p, w) && is_watched;
            }
            if (is_watched) {
                begin_part(cam, p, w);
            }
        }
        w.is_over = true;
        if (!is_watched) {
            w.part.end = w.end;
        } else {
            if (awaken(cam, pixel, p, w)) {
                w.is_over = EFFECT_SHOT ? watch_noisy(cam, pixel, p, w) : watch_quiet(cam, p, w);
                // A pixel that is held to the part's end has nothing to watch in the rest of it.
                w.is_over = w.is_over || (w.is_held && p.release_ns > int(w.part.end));
            } else {
                w.is_over = !needs_draw();
            }
            if (w.is_over) {
                end_part(w.part, p);
            }
        }
    } while (walk_goes_on(n, w) && !needs_draw());
}

// What an interval that ends at `end` leaves of the time of a release.
int release_after(int release_ns, uint end) {
    return max(release_ns - int(end), -LONGEST_NS);
}

void end_walk(Camera cam, Walk w, inout PixelState p) {
    p.events += w.ordinal;
    p.release_ns = release_after(p.release_ns, w.end);
}
