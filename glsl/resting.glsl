// Pixels at rest. In still light a pixel with leak or shot noise sends something only when a clock of its noise runs out,
// and that time is in closed form. Until then `cross` passes it over (PIXELS_REST): its state stays as it was at the end
// of the interval in which it was walked last, and is caught up when it is walked again. Both give the same bits.
//
// A pixel's word of rest has in its low half its wake, before which it sends nothing while its light is still, in units of
// 2^REST_BITS ns since the epoch, modulo 2^16. In its high half it has two counts modulo 2^8: how often each of the two
// lengths of intervals that the camera's row tells had occurred when the pixel was walked last. Intervals of one length
// spend the same, so these counts are all that is needed of the past. The host sees to it that no third length comes.
//
// Needs state_words.glsl and a pixel model, which brings the two functions without a body.

layout(set = 0, binding = SLOT_RESTS, std140) uniform Buffer_rests { Rest rests[MAX_CAMERAS]; };

const int REST_BITS = 18;

// Lets `counts` intervals of these lengths pass, in which the light was still at this level and the pixel sent nothing.
void pass_intervals(Camera cam, uvec2 counts, uvec2 lengths_ns, int level, inout PixelState p);

// How long a pixel with this state at the interval's end surely sends nothing while its light stays at this level, in
// units of wakes.
uint rest_units(Camera cam, PixelState p, int level);

// Longest rest: units, so that wakes compare modulo 2^16 with the ends of intervals up to a second later (an interval is no
// longer); and intervals, so that counts do.
const float LONGEST_REST = 28000.0;
const uint MOST_INTERVALS = 250u;

// End of the interval in units of wakes.
uint end_units(Camera cam) {
    const uint64_t end_ns = uint64_t(cam.start_ns - cam.epoch_ns) + uint64_t(cam.interval_ns);
    return uint((end_ns >> REST_BITS) & uint64_t(0xffffu));
}

// Intervals of either length since the pixel with this word was walked last.
uvec2 intervals_since(Rest rest, uint word) {
    return uvec2((rest.counts - (word >> 16)) & 0xffu, ((rest.counts >> 8) - (word >> 24)) & 0xffu);
}

// Whether a pixel has to be walked though its light is still. One that an earlier attempt at this tick or another workgroup
// has just walked had to be.
bool is_awake(Camera cam, Rest rest, uint word) {
    const uvec2 since = intervals_since(rest, word);
    const int left = int((word - end_units(cam)) << 16);
    return rest.mode != REST_ALLOWED || word >> 16 == rest.counts >> 16 || left <= 0 || since.x + since.y >= MOST_INTERVALS;
}

// The word of a pixel that is walked in this interval and rests for so many units after its end.
uint rest_word(Camera cam, Rest rest, uint units) {
    return ((end_units(cam) + units) & 0xffffu) | (rest.counts & 0xffff0000u);
}

// Brings the state of a pixel with this word up to the interval's start.
void catch_up(Camera cam, Rest rest, uint word, int level, inout PixelState p) {
    const uvec2 since = intervals_since(rest, word);
    if (rest.mode != REST_UNKNOWN && since != uvec2(0u)) {
        pass_intervals(cam, since, uvec2(rest.first_ns, rest.second_ns), level, p);
    }
}

// Catches up a pixel between two ticks.
void catch_up_pixel(Camera cam, uvec2 at) {
    if (at.x >= cam.width || at.y >= cam.height) {
        return;
    }
    const uint pixel = at.y * cam.width + at.x;
    const Rest rest = rests[cam.slot];
    PixelState p;
    Source s;
    read_pixel(cam, at, p, s);
    if (is_armed(p)) {
        catch_up(cam, rest, load_state(cam, pixel, STATE_REST), to_q24(s.log_previous), p);
        store_pixel(cam, pixel, p);
    }
}
