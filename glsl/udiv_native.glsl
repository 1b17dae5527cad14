// Division of event times and pixel numbers, by the device's own instruction.
uint fast_udiv(uint x, uint divisor) {
    return x / divisor;
}
