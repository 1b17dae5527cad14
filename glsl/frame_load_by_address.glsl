// Loads of `planes` and `motion`, as GPUs read fastest. Only for words that this kernel does not write.
#include "half_pel_row.glsl"

float load_plane(uint word) {
    return planes[word];
}

vec2 load_motion(uint element) {
    return motion[element];
}

// Entry `i` of a row of a half-pel frame whose first entry is word `row`.
float load_in_row(Camera cam, uint row, uint i) {
    return HalfPelRow(cam.planes_address + 4u * row).v[i];
}

// The twelve taps of a cell; word `first` is the entry up and left of the cell.
CubicTaps load_taps(Camera cam, uint first) {
    return load_taps_by_address(cam, first);
}
