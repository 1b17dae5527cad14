// Division by a float reciprocal, for devices that divide one lane after the other and multiply all lanes at once.

// x / divisor, exact for divisors below 2^30.
uint float_udiv(uint x, uint divisor) {
    const float inverse = 1.0 / float(divisor);
    const uint near = uint(min(float(x) * inverse, 4294967040.0));
    const int over = int(x - near * divisor);
    const int more = int(floor(float(over) * inverse));
    const int rest = over - more * int(divisor);
    return near + uint(more + (rest < 0 ? -1 : rest >= int(divisor) ? 1 : 0));
}
