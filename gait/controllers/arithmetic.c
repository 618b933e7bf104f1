//? clip
static float NAME_clip(float x, float limit)
{
    const float low = x < -limit ? -limit : x;
    return limit < low ? limit : low;
}

//.
//? tanh
/* The Pade approximant [7/6] of tanh(z / 32), then five times the double-angle formula. Its
 * coefficients are 17325, 378 and 1, and 62370, 3150 and 28, all divided by 135135. */
static float NAME_tanh(float z)
{
    const float y = NAME_clip(z, 20.0f) * 0.03125f;
    const float q = y * y;
    float n = y * (1.0f + q * (0.12820514f + q * (0.002797203f + q * 7.4000072e-06f)));
    float d = 1.0f + q * (0.46153846f + q * (0.023310022f + q * 0.00020720021f));
    for (int i = 0; i < 5; i++) {
        const float twice = 2.0f * n * d;
        d = d * d + n * n;
        n = twice;
    }
    return n / d;
}

//.
