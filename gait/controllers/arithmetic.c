//? clip
static float NAME_clip(float x, float limit)
{
    const float low = x < -limit ? -limit : x;
    return limit < low ? limit : low;
}

//.
//? tanh
/* The Pade approximant [7/6] of tanh(z / 32), then five times the double-angle formula. */
static float NAME_tanh(float z)
{
    const float y = NAME_clip(z, 20.0f) * 0.03125f;
    const float q = y * y;
    float n = y * (1.0f + q * ((float)(17325 / 135135.0)
                   + q * ((float)(378 / 135135.0) + q * (float)(1 / 135135.0))));
    float d = 1.0f + q * ((float)(62370 / 135135.0)
              + q * ((float)(3150 / 135135.0) + q * (float)(28 / 135135.0)));
    for (int i = 0; i < 5; i++) {
        const float twice = 2.0f * n * d;
        d = d * d + n * n;
        n = twice;
    }
    return n / d;
}

//.
