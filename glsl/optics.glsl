// The table of optics, and a lamp that flickers; twin of the model crate's `optics`. Needs EFFECT_FLICKER. Planes hold
// steady light: the lamp is added to a level where a pixel sees it.

layout(set = 0, binding = SLOT_OPTICS, std140) uniform Buffer_optics { Optics optics[MAX_CAMERAS]; };

// Half a turn over the largest phase.
const float RADIANS_PER_PHASE = 3.14159265358979 / 2147483648.0;

// Factor of the lamp's light at a time after the interval's start.
float lamp_at(Camera cam, uint since_start_ns) {
    const Optics row = optics[cam.slot];
    uint high, low;
    umulExtended(row.flicker_step, since_start_ns, high, low);
    const uint turned = (high << (64 - FLICKER_FRACTION_BITS)) | (low >> (FLICKER_FRACTION_BITS - 32));
    return fma(row.flicker_depth, sin(float(int(row.flicker_phase + turned)) * RADIANS_PER_PHASE), 1.0);
}

// The level ln(S factor + dark) of a pixel whose level in steady light, ln(S + dark), is `level`.
float lit(Camera cam, float level, float factor) {
    const float light = max(factor, 0.0);
    return level + log(fma(1.0 - light, exp(cam.log_dark - level), light));
}

// The level that a pixel sees at the interval's start and at its end, which is the frame's time.
float lit_at_start(Camera cam, float level) {
    return EFFECT_FLICKER ? lit(cam, level, optics[cam.slot].lamp_start) : level;
}

float lit_at_end(Camera cam, float level) {
    return EFFECT_FLICKER ? lit(cam, level, optics[cam.slot].lamp_end) : level;
}
