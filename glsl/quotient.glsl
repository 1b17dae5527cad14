#ifndef QUOTIENT_GLSL
#define QUOTIENT_GLSL

// x / divisor, which is below 2^30. The software driver divides lane after lane, and multiplies all of them at once.
// Needs BRANCHES.
uint quotient(uint x, uint divisor) {
    if (BRANCHES) {
        return x / divisor;
    }
    const float inverse = 1.0 / float(divisor);
    const uint near = uint(min(float(x) * inverse, 4294967040.0));
    const int over = int(x - near * divisor);
    const int more = int(floor(float(over) * inverse));
    const int rest = over - more * int(divisor);
    return near + uint(more + (rest < 0 ? -1 : rest >= int(divisor) ? 1 : 0));
}

#endif
