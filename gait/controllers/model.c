/* Written by `aquafish export`: the code of NAME.h, which says how to use it.
 *
 * All arithmetic is IEEE 754 double precision. A step has the bits of the simulator's float64 if
 * the compiler neither fuses a * b + c nor reorders: -ffp-contract=off (gcc -std=c99 and clang here
 * do so by themselves), no -ffast-math, and on 32-bit x86 -msse2 -mfpmath=sse. To check it with the
 * test vectors beside this file:
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

const double NAME_bodies[NAME_body_count][$SIZE_COUNT] = {$SIZES};

$FUNCTIONS
void NAME_predict(double state[$STATE_NUMBERS], const double robot[$ROBOT_NUMBERS],
                  const double current[3], const double servo_gain[$FINS], const double goal[3],
                  const double *commands, int count, int interval, double *seen)
{
    for (int k = 0; k < count; k++) {
        double command[$FINS];
        for (int i = 0; i < $FINS; i++)
            command[i] = servo_gain[i] * commands[$FINS * k + i];
        for (int i = 0; i < interval; i++)
            NAME_step(state, robot, current, command);
        NAME_sense(state, goal, seen + NAME_channels * k);
    }
}

#ifdef NAME_TEST
static void NAME_answer(long steps, const double *row, double *found)
{
    static double state[NAME_state_numbers], robot[NAME_robot_numbers];
    const double density[1] = {$DENSITY}, drag[2] = {$DRAG};
    const double fin_angles[$FINS] = {$FIN_ANGLES}, servo_gain[$FINS] = {$SERVO_GAIN};
    const double current[3] = {$CURRENT}, goal[3] = {$GOAL};
    if (steps == 0) {
        NAME_robot_rows(NAME_bodies[0], density, drag, robot);
        NAME_start(fin_angles, state);
    }
    NAME_predict(state, robot, current, servo_gain, goal, row, 1, $INTERVAL, found);
}

//+ self_test.c
#endif
