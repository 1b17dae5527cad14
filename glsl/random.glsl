// Twin of the model crate's `random`: integer arithmetic alone, so that every device gives the same bits.

uvec4 philox4x32_10(uvec4 c, uvec2 k) {
    for (int round = 0; round < 10; ++round) {
        uint high0, low0, high1, low1;
        umulExtended(c.x, 0xD2511F53u, high0, low0);
        umulExtended(c.z, 0xCD9E8D57u, high1, low1);
        c = uvec4(high1 ^ c.y ^ k.x, low1, high0 ^ c.w ^ k.y, low0);
        k += uvec2(0x9E3779B9u, 0xBB67AE85u);
    }
    return c;
}

uvec4 draw(Camera cam, uint pixel, uint stream, uint index) {
    return philox4x32_10(uvec4(index, stream, pixel, cam.camera), uvec2(cam.seed_low, cam.seed_high));
}

int times_q31(int value, int x) {
    int high, low;
    imulExtended(value, x, high, low);
    return high << 1;
}

// -ln((word | 2) / 2^32), Q5.27.
uint exponential_q27(uint word) {
    const uint u = word | 2u;
    const uint zeros = uint(31 - findMSB(u));
    const int x = int((u << zeros) & 0x7fffffffu);
    int log2_q30 = 0;
    [[unroll]] for (int i = 8; i >= 0; --i) {
        log2_q30 = times_q31(log2_q30, x) + LOG2_COEFFICIENTS_Q30[i];
    }
    log2_q30 = min(times_q31(log2_q30, x), 1 << 30);
    const uint minus_log2_q27 = ((zeros + 1u) << HAZARD_FRACTION_BITS) - uint(log2_q30 >> 3);
    uint high, low;
    umulExtended(minus_log2_q27, 2977044472u, high, low);
    return high;
}

// How far the leak of a pixel has come when it is armed, in [0, 1), by a word of its draw.
float leak_phase(uint word) {
    return float(word >> 8) * (1.0 / 16777216.0);
}

// Irwin-Hall jitter of standard deviation `sigma_ns`.
int jitter_ns(uvec4 words, uint sigma_ns) {
    const uvec4 quarter = words >> 4;
    const int64_t sum = int64_t(quarter.x) + int64_t(quarter.y) + int64_t(quarter.z) + int64_t(quarter.w)
        - (int64_t(1) << 29);
    const int64_t unit_q12 = (sum * int64_t(7094)) >> 28;
    return int((unit_q12 * int64_t(sigma_ns)) >> 12);
}
