// Words of state of a pixel, of whichever model. Needs `state`.

uint state_index(Camera cam, uint pixel, uint word) {
    return cam.state_base + word * cam.pixels + pixel;
}

uint load_state(Camera cam, uint pixel, uint word) {
    return state[state_index(cam, pixel, word)];
}

void store_state(Camera cam, uint pixel, uint word, uint value) {
    state[state_index(cam, pixel, word)] = value;
}
