/* Written by `aquafish export`: the code of NAME.h, which says how to use it.
 *
 * All arithmetic is IEEE 754 single precision. Each sum begins with the bias and adds the products
 * in the order of the inputs, so the bits do not depend on a library. They are those of the test
 * vectors if the compiler neither fuses a * b + c nor reorders: -ffp-contract=off (gcc -std=c99
 * and clang here do so by themselves), no -ffast-math, and on 32-bit x86 -msse2 -mfpmath=sse. To
 * check it with the test vectors beside this file:
 *
 *     cc -std=c99 -DNAME_TEST NAME.c -lm -o NAME && ./NAME < NAME.csv
 */
#include <float.h>
#include <math.h>

#include "NAME.h"

//+ checks.c
#ifdef __clang__
#pragma STDC FP_CONTRACT OFF
#endif

enum {
    NAME_layers = $LAYERS,
    NAME_widest = $WIDEST
};

/* Layer l has width[l] inputs and width[l + 1] nodes. Of each node, the bias and its weights. */
static const int NAME_width[] = {$WIDTHS};
static const float NAME_numbers[] = {$NUMBERS};
//? normalized

/* The network sees (observation - mean) / scale$WITHIN. */
static const float NAME_mean[] = {$MEAN};
static const float NAME_scale[] = {$SCALE};
//.
//? bounds

const float NAME_low[NAME_actions] = {$LOW};
const float NAME_high[NAME_actions] = {$HIGH};
//.

//+ arithmetic.c
//? hidden
/* The activation of a node between observation and outputs. */
static float NAME_activation(float z)
{
//.
//? Tanh
    return NAME_tanh(z);
//.
//? ReLU
    return z < 0.0f ? 0.0f : z;
//.
//? LeakyReLU
    return z < 0.0f ? 0.01f * z : z;
//.
//? ELU
    const float t = NAME_tanh(z < 0.0f ? 0.5f * z : 0.0f);
    return z < 0.0f ? 2.0f * t / (1.0f - t) : z;
//.
//? SiLU
    return z * (0.5f + 0.5f * NAME_tanh(0.5f * z));
//.
//? hidden
}

//.
/* Return the outputs, in one of two places for NAME_widest numbers. */
static const float *NAME_outputs(const float observation[NAME_inputs], float *values, float *next)
{
    const float *number = NAME_numbers;
    for (int i = 0; i < NAME_inputs; i++)
//? raw
        values[i] = observation[i];
//.
//? normalized
        values[i] = (observation[i] - NAME_mean[i]) / NAME_scale[i];
//.
//? limited
    for (int i = 0; i < NAME_inputs; i++)
        values[i] = NAME_clip(values[i], $LIMIT);
//.
    for (int layer = 0; layer < NAME_layers; layer++) {
        for (int node = 0; node < NAME_width[layer + 1]; node++) {
            float z = *number++;
            for (int k = 0; k < NAME_width[layer]; k++)
                z = z + *number++ * values[k];
//? hidden
            next[node] = layer < NAME_layers - 1 ? NAME_activation(z) : z;
//.
//? single
            next[node] = z;
//.
        }
        float *const done = next;
        next = values;
        values = done;
    }
    return values;
}

//? bounds
void NAME_act(const float observation[NAME_inputs], float action[NAME_actions])
{
    float values[NAME_widest], next[NAME_widest];
    const float *output = NAME_outputs(observation, values, next);
    for (int i = 0; i < NAME_actions; i++) {
//.
//? clipped
        const float most = NAME_high[i] < output[i] ? NAME_high[i] : output[i];
        action[i] = output[i] < NAME_low[i] ? NAME_low[i] : most;
//.
//? squashed
        const float share = 0.5f * (NAME_tanh(output[i]) + 1.0f);
        action[i] = NAME_low[i] + share * (NAME_high[i] - NAME_low[i]);
//.
//? bounds
    }
}
//.
//? choice
int NAME_act(const float observation[NAME_inputs])
{
    float values[NAME_widest], next[NAME_widest];
    const float *output = NAME_outputs(observation, values, next);
    int best = 0;
    for (int i = 1; i < NAME_actions; i++)
        if (output[i] > output[best])
            best = i;
    return best;
}
//.

#ifdef NAME_TEST
static void NAME_answer(long steps, const float *row, float *found)
{
    (void)steps;
//? bounds
    NAME_act(row, found);
//.
//? choice
    found[0] = (float)NAME_act(row);
//.
}

//+ self_test.c
#endif
