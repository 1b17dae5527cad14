// Blocks that the square of a block passes with one of its representatives: at an instant, and on the straight line
// between two. Twin of the oracle's `passed_blocks`. Needs surfaces.glsl.

// Positions farther away than this are nowhere, pixels: lengths of larger numbers have none.
const float FARTHEST_PX = 1e15;

// NaN is nowhere either.
bool is_somewhere(vec2 place) {
    return all(lessThan(abs(place), vec2(FARTHEST_PX)));
}

// Side of the square of a block's pixel centres and what they reach, pixels.
const float SQUARE_PX = float(BLOCK_PX - 1u) + 2.0 * REACH_PX;

// First corner of a block's square that is displaced by `shift`.
vec2 square_corner(ivec2 block, vec2 shift) {
    return vec2(block * int(BLOCK_PX)) + shift - REACH_PX;
}

// First and last of `count` blocks along an axis that lie between two places, pixels. Empty (first beyond last) if none
// does.
ivec2 blocks_within(float first, float last, uint count) {
    // Far outside, a block's number would not fit an integer.
    const vec2 blocks = clamp(floor(vec2(first, last) / float(BLOCK_PX)), vec2(-1.0), vec2(count));
    return ivec2(max(int(blocks.x), 0), min(int(blocks.y), int(count) - 1));
}

// First and last block (xy, zw) that the square of a block passes, whose representative is displaced by `shift`; within
// the image. Empty (first beyond last) if it passes none.
ivec4 passed_blocks(Camera cam, ivec2 block, vec2 shift) {
    const vec2 first = square_corner(block, shift);
    const vec2 last = first + SQUARE_PX;
    const ivec2 columns = blocks_within(first.x, last.x, cam.blocks_x);
    const ivec2 rows = blocks_within(first.y, last.y, cam.blocks / cam.blocks_x);
    return ivec4(columns.x, rows.x, columns.y, rows.y);
}

// First and last column of a row of blocks that the square of a block passes on a straight line between two shifts of
// its representative; within the image. Empty (first beyond last) if it passes none.
ivec2 columns_between(Camera cam, ivec2 block, vec2 shift_a, vec2 shift_b, int row) {
    // From the nearer end on: rounding is a share of the distance from there.
    const bool a_is_near = max(abs(shift_a.x), abs(shift_a.y)) <= max(abs(shift_b.x), abs(shift_b.y));
    const vec2 from = a_is_near ? shift_a : shift_b;
    const vec2 way = (a_is_near ? shift_b : shift_a) - from;
    const vec2 first = square_corner(block, from);
    // The shares of the way between which the square reaches into the row.
    const float upper = float(row * int(BLOCK_PX)) - SQUARE_PX - first.y;
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
    return blocks_within(min(ends.x, ends.y), max(ends.x, ends.y) + SQUARE_PX, cam.blocks_x);
}

// First and last row of blocks that the square of a block passes between two shifts of its representative; within the
// image. Empty (first beyond last) if it passes none, or none but those that it passes at one of them.
ivec2 rows_between(Camera cam, ivec2 block, vec2 shift_a, vec2 shift_b) {
    const vec2 first_a = square_corner(block, shift_a);
    const vec2 first_b = square_corner(block, shift_b);
    const vec2 low_a = floor(first_a / float(BLOCK_PX));
    const vec2 low_b = floor(first_b / float(BLOCK_PX));
    const vec2 high_a = floor((first_a + SQUARE_PX) / float(BLOCK_PX));
    const vec2 high_b = floor((first_b + SQUARE_PX) / float(BLOCK_PX));
    const bvec2 same = bvec2(low_a.x == low_b.x && high_a.x == high_b.x, low_a.y == low_b.y && high_a.y == high_b.y);
    const bvec2 meet = bvec2(
        low_a.x <= high_b.x + 1.0 && low_b.x <= high_a.x + 1.0, low_a.y <= high_b.y + 1.0 && low_b.y <= high_a.y + 1.0);
    if ((same.x && meet.y) || (same.y && meet.x)) {
        return ivec2(0, -1);
    }
    return blocks_within(
        min(first_a.y, first_b.y), max(first_a.y, first_b.y) + SQUARE_PX, cam.blocks / cam.blocks_x);
}
