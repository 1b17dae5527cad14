// Blocks that the square of a block passes with one of its representatives: at an instant, and on the straight line
// between two. Twin of the oracle's `passed_blocks`. Needs surfaces.glsl.

// Positions farther away than this are nowhere, pixels: lengths of larger numbers have none.
const float FARTHEST_PX = 1e15;

// NaN is nowhere either.
bool is_somewhere(vec2 place) {
    return all(lessThan(abs(place), vec2(FARTHEST_PX)));
}

// First and last block (xy, zw) that the square of a block passes, whose representative is displaced by `shift`; within
// the image. Empty (first beyond last) if it passes none.
ivec4 passed_blocks(Camera cam, ivec2 block, vec2 shift) {
    const ivec2 last_block = ivec2(cam.blocks_x, cam.blocks / cam.blocks_x) - 1;
    const vec2 first = vec2(block * int(BLOCK_PX)) + shift - REACH_PX;
    const vec2 last = first + (float(BLOCK_PX - 1) + 2.0 * REACH_PX);
    // Far outside, a block's number would not fit an integer.
    const vec2 most = vec2(last_block) + 1.0;
    const vec2 low = clamp(floor(first / float(BLOCK_PX)), vec2(-1.0), most);
    const vec2 high = clamp(floor(last / float(BLOCK_PX)), vec2(-1.0), most);
    return ivec4(max(ivec2(low), ivec2(0)), min(ivec2(high), last_block));
}

// First and last column of a row of blocks that the square of a block passes on a straight line between two shifts of
// its representative; within the image. Empty (first beyond last) if it passes none.
ivec2 columns_between(Camera cam, ivec2 block, vec2 shift_a, vec2 shift_b, int row) {
    // From the nearer end on: rounding is a share of the distance from there.
    const bool a_is_near = max(abs(shift_a.x), abs(shift_a.y)) <= max(abs(shift_b.x), abs(shift_b.y));
    const vec2 from = a_is_near ? shift_a : shift_b;
    const vec2 way = (a_is_near ? shift_b : shift_a) - from;
    const vec2 first = vec2(block * int(BLOCK_PX)) + from - REACH_PX;
    const float side = float(BLOCK_PX - 1) + 2.0 * REACH_PX;
    // The shares of the way between which the square reaches into the row.
    const float upper = float(row * int(BLOCK_PX)) - side - first.y;
    const float lower = float((row + 1) * int(BLOCK_PX)) - first.y;
    vec2 shares = vec2(0.0, 1.0);
    if (way.y != 0.0) {
        shares = way.y > 0.0 ? vec2(upper, lower) / way.y : vec2(lower, upper) / way.y;
        shares = vec2(max(shares.x, 0.0), min(shares.y, 1.0));
    } else if (upper > 0.0 || lower <= 0.0) {
        return ivec2(0, -1);
    }
    if (shares.x > shares.y) {
        return ivec2(0, -1);
    }
    const vec2 ends = first.x + way.x * shares;
    const float last_column = float(cam.blocks_x) - 1.0;
    const float low = clamp(floor(min(ends.x, ends.y) / float(BLOCK_PX)), -1.0, last_column + 1.0);
    const float high = clamp(floor((max(ends.x, ends.y) + side) / float(BLOCK_PX)), -1.0, last_column + 1.0);
    return ivec2(max(int(low), 0), min(int(high), int(last_column)));
}

// First and last row of blocks that the square of a block passes between two shifts of its representative; within the
// image. Empty (first beyond last) if it passes none, or none but those that it passes at one of them.
ivec2 rows_between(Camera cam, ivec2 block, vec2 shift_a, vec2 shift_b) {
    const float last_row = float(cam.blocks / cam.blocks_x) - 1.0;
    const vec2 first_a = vec2(block * int(BLOCK_PX)) + shift_a - REACH_PX;
    const vec2 first_b = vec2(block * int(BLOCK_PX)) + shift_b - REACH_PX;
    const float side = float(BLOCK_PX - 1) + 2.0 * REACH_PX;
    const vec2 low_a = floor(first_a / float(BLOCK_PX));
    const vec2 low_b = floor(first_b / float(BLOCK_PX));
    const vec2 high_a = floor((first_a + side) / float(BLOCK_PX));
    const vec2 high_b = floor((first_b + side) / float(BLOCK_PX));
    const bvec2 same = bvec2(low_a.x == low_b.x && high_a.x == high_b.x, low_a.y == low_b.y && high_a.y == high_b.y);
    const bvec2 meet = bvec2(
        low_a.x <= high_b.x + 1.0 && low_b.x <= high_a.x + 1.0, low_a.y <= high_b.y + 1.0 && low_b.y <= high_a.y + 1.0);
    if ((same.x && meet.y) || (same.y && meet.x)) {
        return ivec2(0, -1);
    }
    const float low = clamp(min(low_a.y, low_b.y), -1.0, last_row + 1.0);
    const float high = clamp(max(high_a.y, high_b.y), -1.0, last_row + 1.0);
    return ivec2(max(int(low), 0), min(int(high), int(last_row)));
}
