/* Written by `aquafish export`: the controller of a swimming robot with $FINS servos.
 *
 * $DESCRIPTION
 *
 * Include this file where you call it, compile NAME.c with your program, and link with -lm:
 *
 *     NAME_state state;
 *     NAME_reset(&state$RESET_CALL);  // before a swim
 *     NAME_step(&state$STEP_CALL, command);  // every $MILLISECONDS ms (NAME_milliseconds)
 *
 * command    of the servos, to hold until the next step:
$SERVOS
//? imu
 * imu        the world's up (x, y, z) and north (x, y, z; the heading to swim in) as unit vectors,
 *            and the angular velocity (x, y, z) in rad/s, all in body axes: x is to the right,
 *            y forward, z up.
//.
//? goal
 * goal       the way to the goal (x, y, z) in body axes, in units of 5 cm.
//.
//? senses
 *            A reading that is NaN, infinite or out of range (up and north 1, $RANGES)
 *            is not observed: the last one is held.
//.
//? fins
 * fin_angles where each fin begins, or the phase of its beat, in rad, in the order of the servos.
 * servo_gain how fast each servo turns relative to its command: 1 if it is whole.
 *            From these and its commands, the controller reckons the angles (state.fins, in turns
 *            of 2 pi). Where an encoder knows better, set state.fins before a step.
//.
 */
#ifndef NAME_H_$EXPORT
#define NAME_H_$EXPORT

#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

/* The inputs of the network:
 * $INPUT_NAMES */
enum {
    NAME_milliseconds = $MILLISECONDS,
    NAME_inputs = $INPUTS,
    NAME_nodes = $NODES,
    NAME_layers = $LAYERS,
    NAME_widest_layer = $WIDEST
};

typedef struct {
    float values[NAME_inputs + NAME_nodes]; /* the last $FINS: the action, in [-1, 1] */
//? clock
    uint32_t steps; /* since the reset */
//.
//? fins
    float fins[$FINS];  /* in turns */
    float gain[$FINS];
//.
//? goal
    float goal[3];  /* the last that was observed */
//.
} NAME_state;

void NAME_reset(NAME_state *state$RESET_PARAMETERS);
void NAME_step(NAME_state *state$STEP_PARAMETERS, float command[$FINS]);

#ifdef __cplusplus
}
#endif

#endif
