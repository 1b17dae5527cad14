// Elementary functions of known accuracy. The built-in ones may be off by 2^-11 (sin) or differ between devices.

const float TAU = 6.28318530717958647692;

// Sine of an angle in turns, error below 3e-7.
float sin_turns(float turns) {
    float x = turns - round(turns);
    x = abs(x) > 0.25 ? sign(x) * 0.5 - x : x;
    float z = x * TAU;
    float z2 = z * z;
    return z * (1.0 + z2 * (-1.6666667e-1 + z2 * (8.3333333e-3 + z2 * (-1.9841270e-4
        + z2 * (2.7557319e-6 + z2 * (-2.5052108e-8 + z2 * 1.6059044e-10))))));
}

// Exponential, relative error below 3e-7; zero below -87, finite above 88.
float exp_exact(float x) {
    float clamped = clamp(x, -87.0, 88.0);
    float n = round(clamped * 1.44269504);
    float r = (clamped - n * 0.693359375) + n * 2.12194440e-4;
    float p = 1.0 + r * (1.0 + r * (0.5 + r * (1.6666667e-1 + r * (4.1666667e-2
        + r * (8.3333333e-3 + r * (1.3888889e-3 + r * 1.9841270e-4))))));
    return x < -87.0 ? 0.0 : p * uintBitsToFloat(uint(int(n) + 127) << 23);
}

float tanh_exact(float x) {
    float e = exp_exact(-2.0 * abs(x));
    return sign(x) * (1.0 - e) / (1.0 + e);
}

// Smooth `max(x, 0)`, rounded off within `width` of 0. Always positive.
float soft_positive(float x, float width) {
    float root = sqrt(x * x + width * width);
    return x >= 0.0 ? 0.5 * (x + root) : 0.5 * width * width / (root - x);
}
