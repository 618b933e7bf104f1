/* Written by `aquafish export`: the code of NAME.h, which says how to use it.
 *
 * All arithmetic is IEEE 754 single precision, except for the time, which is counted in double. A
 * step has the bits of the simulator's float32 if the compiler neither fuses a * b + c nor
 * reorders: -ffp-contract=off (gcc -std=c99 and clang here do so by themselves), no -ffast-math,
 * and on 32-bit x86 -msse2 -mfpmath=sse. To check it with the test vectors beside this file:
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

/* Layer l ends before node layer_end[l]. Node n computes tanh(2.5 (bias + response sum)); its sum
 * has the connections first[n] to first[n + 1] - 1, each a weight times the value of its source:
 * an input, or node s as source inputs + s. */
static const uint16_t NAME_layer_end[] = {$LAYER_END};
static const uint32_t NAME_first[] = {$FIRST};
static const uint16_t NAME_source[] = {$SOURCE};
static const float NAME_weight[] = {$WEIGHT};
static const float NAME_bias[] = {$BIAS};
static const float NAME_response[] = {$RESPONSE};

//+ arithmetic.c
//? senses
/* Whether a reading is one of a sensor: NaN, infinities and numbers out of its range are not. */
static int NAME_observed(float reading, float limit)
{
    return fabsf(reading) <= limit;
}

//.
//? waves
/* Sine and cosine of an angle in turns: Taylor series of an eighth of it, and three doublings. */
static void NAME_wave(float turns, float wave[2])
{
    const float x = (turns - floorf(turns + 0.5f)) * (float)(6.283185307179586 / 8);
    const float z = x * x;
    float s = fmaf(z, (float)(1 / 6227020800.0), (float)(-1 / 39916800.0));
    s = fmaf(z, s, (float)(1 / 362880.0));
    s = fmaf(z, s, (float)(-1 / 5040.0));
    s = fmaf(z, s, (float)(1 / 120.0));
    s = fmaf(z, s, (float)(-1 / 6.0));
    float c = fmaf(z, (float)(-1 / 87178291200.0), (float)(1 / 479001600.0));
    c = fmaf(z, c, (float)(-1 / 3628800.0));
    c = fmaf(z, c, (float)(1 / 40320.0));
    c = fmaf(z, c, (float)(-1 / 720.0));
    c = fmaf(z, c, (float)(1 / 24.0));
    c = fmaf(z, c, -0.5f);
    s = fmaf(x * z, s, x);
    c = fmaf(z, c, 1.0f);
    for (int i = 0; i < 3; i++) {
        const float twice = 2.0f * s * c;
        c = c * c - s * s;
        s = twice;
    }
    wave[0] = s;
    wave[1] = c;
}

//.
void NAME_reset(NAME_state *state$RESET_PARAMETERS)
{
    for (int i = 0; i < NAME_inputs + NAME_nodes; i++)
        state->values[i] = 0.0f;
//? clock
    state->steps = 0;
//.
//? fins
    for (int i = 0; i < $FINS; i++) {
        state->fins[i] = (float)((double)fin_angles[i] / 6.283185307179586);
        state->gain[i] = servo_gain[i];
    }
//.
//? goal
    for (int i = 0; i < 3; i++)
        state->goal[i] = 0.0f;
//.
}

void NAME_step(NAME_state *state$STEP_PARAMETERS, float command[$FINS])
{
    float next[NAME_widest_layer];
    float *input = state->values;
//? imu

    /* What is not observed keeps its last value, or 0 at first. */
    for (int i = 0; i < 6; i++, input++)
        if (NAME_observed(imu[i], $UNIT_LIMIT))
            *input = imu[i];
    for (int i = 6; i < 9; i++, input++) /* 2 rad/s is 1 */
        if (NAME_observed(imu[i], $GYRO_LIMIT))
            *input = NAME_clip(imu[i] * 0.5f, 1.0f);
//.
//? clock

    /* Harmonics of the clock, by the angle addition formulas. */
    const float time = (float)((double)state->steps++ * $INTERVAL * 0.01);
    float first[2], wave[2];
    NAME_wave($CLOCK * time, first);
    wave[0] = first[0];
    wave[1] = first[1];
    for (int k = 0; k < $HARMONICS; k++) {
        const float sine = wave[0], cosine = wave[1];
        *input++ = sine;
        *input++ = cosine;
        wave[0] = sine * first[1] + cosine * first[0];
        wave[1] = cosine * first[1] - sine * first[0];
    }
//.
//? fins

    for (int i = 0; i < $FINS; i++, input += 2)
        NAME_wave(state->fins[i], input);
//.
//? goal

    /* Bounded, with the direction kept: a way d long becomes d / sqrt(d^2 + 5^2). */
    float *way = state->goal;
    for (int i = 0; i < 3; i++)
        if (NAME_observed(goal[i], $GOAL_LIMIT))
            way[i] = goal[i];
    const float shrink = 1.0f / sqrtf(fmaf(way[0], way[0],
                                      fmaf(way[1], way[1], fmaf(way[2], way[2], 25.0f))));
    for (int i = 0; i < 3; i++)
        *input++ = way[i] * shrink;
//.

    /* input is now the first node's value. A layer's nodes see their own values of the step before. */
    for (int layer = 0, node = 0; layer < NAME_layers; layer++) {
        const int begin = node, end = NAME_layer_end[layer];
        for (; node < end; node++) {
            float total = 0.0f;
            for (uint32_t k = NAME_first[node]; k < NAME_first[node + 1]; k++)
                total = total + NAME_weight[k] * state->values[NAME_source[k]];
            const float z = 2.5f * (NAME_bias[node] + NAME_response[node] * total);
            next[node - begin] = $ACTIVATION;
        }
        for (int i = begin; i < end; i++)
            input[i] = next[i - begin];
    }

    const float *action = input + NAME_nodes - $FINS;
$COMMANDS
//? fins

    for (int i = 0; i < $FINS; i++)
        state->fins[i] = state->fins[i] + $PERIOD * (state->gain[i] * command[i]);
//.
}

#ifdef NAME_TEST
static void NAME_answer(long steps, const float *row, float *found)
{
    static NAME_state state;
//? fins
    const float fin_angles[$FINS] = {$FIN_ANGLES}, servo_gain[$FINS] = {$SERVO_GAIN};
//.
    if (steps == 0)
        NAME_reset(&state$RESET_CALL);
    (void)row; /* which a controller without senses does not read */
    NAME_step(&state$STEP_TEST, found);
}

//+ self_test.c
#endif
