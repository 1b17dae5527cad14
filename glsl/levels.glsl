// Levels: log intensities of pixels at the ends of sub-steps, from `synthesize` to `cross`.
//
// `levels` is cut into rows of a word for each pixel of a block. A block with `n` sub-steps, n > 1, takes n + 1 of them,
// one after the other: what its pixels may show (see LIST_BITS), the levels at the ends of sub-steps 1 to n - 1, and the
// block's list. A tile takes its rows whole. `levels` need not hold those of all tiles: a tile that found no room is
// left to the next pass of a tick.

// A tile's element of `level_words` has a word for each block: its number of sub-steps, its first row above that, and in
// the highest bit whether nothing in and around it moves or changes.
const uint ROW_SHIFT = 7u;
const uint SUBSTEPS_MASK = (1u << ROW_SHIFT) - 1u;
const uint STILL_BLOCK = 0x80000000u;
const uint ROW_MASK = STILL_BLOCK - (1u << ROW_SHIFT);
// A row that no block has: all pixels of the block are unoccluded, and `cross` makes their levels.
const uint NO_ROW = ROW_MASK >> ROW_SHIFT;
// In all four: the tile has found no room yet; it had some in an earlier pass of this tick.
const uint NO_LEVELS = 0xffffffffu;
const uint HAD_LEVELS = 0xfffffffeu;

// The first row has a word for each pixel: its order of candidates, or of layers, and above it the number of its samples
// that show what neither key frame shows.
const uint LIST_BITS = 24u;
const uint LIST_MASK = (1u << LIST_BITS) - 1u;

// `level_entries` begins with an element for each pass: how many entries there are, and how many rows they take or would
// take. Then come the entries of a pass, each for some sub-steps of a block: row of the camera in the table, number of
// the block, its word as in `level_words`, first sub-step.

// Sub-steps of an entry of a block with this many pixels whose levels are made: as many as a workgroup has threads for.
uint entry_substeps(uint places) {
    return max(LEAST_ENTRY_SUBSTEPS, SYNTHESIZE_THREADS / max(places, 1u));
}

bool has_levels(uvec4 of_tile) {
    return of_tile.x < HAD_LEVELS;
}

bool is_still_tile(uvec4 of_tile) {
    return (of_tile.x & of_tile.y & of_tile.z & of_tile.w & STILL_BLOCK) != 0u;
}

uint substeps_of_levels(uint of_block) {
    return of_block & SUBSTEPS_MASK;
}

// Whether levels of a block with more than one sub-step have rows.
bool has_rows(uint of_block) {
    return (of_block & ROW_MASK) != ROW_MASK;
}

uint row_of_levels(uint of_block) {
    return (of_block & ROW_MASK) >> ROW_SHIFT;
}

// Rows that a block has.
uint rows_of_levels(uint of_block) {
    const uint n = substeps_of_levels(of_block);
    return n > 1u && has_rows(of_block) ? n + 1u : 0u;
}

// A pixel's place in a row.
uint place_in_row(uvec2 at) {
    return (at.y % BLOCK_PX) * BLOCK_PX + at.x % BLOCK_PX;
}

// Word of a pixel in the first row of its block.
uint first_level_word(uint of_block, uvec2 at) {
    return row_of_levels(of_block) * LEVEL_ROW_WORDS + place_in_row(at);
}

// First of the two words of a list with a bit for each pixel of the block whose levels `synthesize` makes.
const uint LIST_PIXELS_WORD = LEVEL_ROW_WORDS - 2u;

// Words of a layer in a list: its place, its slopes, its vector before.
const uint LAYER_WORDS = 10u;
