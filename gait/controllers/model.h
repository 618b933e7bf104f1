/* Written by `aquafish export`: a model of a swimming robot with $FINS servos, which predicts.
 *
 * Include this file where you call it, compile NAME.c with your program, and link with -lm:
 *
 *     double robot[NAME_robot_numbers], state[NAME_state_numbers];
 *     double seen[10 * NAME_channels];
 *     NAME_robot_rows(NAME_bodies[0], density, drag, robot);
 *     NAME_start(fin_angles, state);
 *     NAME_predict(state, robot, current, servo_gain, goal, commands, 10, interval, seen);
 *
 * sizes      of a body, units of 5 cm, in this order; NAME_bodies has $BODIES:
 *            $DIMENSIONS
 * density    of the fins, relative to the water's: 1 if they are neutrally buoyant.
 * drag       factors on the drag of the fins and on that of the body: 1 and 1.
 * fin_angles where each fin begins, or the phase of its beat, in rad, in the order of the servos.
 * current    the water's velocity (x, y, z) in the world, units/s.
 * servo_gain how fast each servo turns relative to its command: 1 if it is whole.
 * goal       a place (x, y, z) in the world, units.
 * command    of the servos. NAME_predict takes one after another, each for `interval` steps of
 *            10 ms. NAME_step takes one that is already multiplied by the servos' gains:
$SERVOS
 * seen       after each command: the world's up (x, y, z) and north (x, y, z) as unit vectors, the
 *            angular velocity (x, y, z) in rad/s, and the way to the goal (x, y, z) in units, all
 *            in body axes: x is to the right, y forward, z up. The first nine are what the
 *            exported controller takes as imu, the last three as its goal.
 * state      attitude (quaternion x, y, z, w), position, velocity (all in the world), angular
 *            velocity (body axes), cosine and sine of each fin's angle or beat in turn, and the
 *            joints' speeds in rad/s. Copy it before a prediction, which moves it on.
 *
 * Time and memory. NAME_step is 10 ms of the robot$LAW. It is $OPERATIONS operations
 * without a loop or a branch:
 * $COUNTS.
 * Its $NUMBERS numbers take $STACK KB of stack without optimization, and a fraction of that with it.
 * state has $STATE_BYTES bytes, robot $ROBOT_BYTES. Nothing is allocated.
 */
#ifndef NAME_H_$EXPORT
#define NAME_H_$EXPORT

#ifdef __cplusplus
extern "C" {
#endif

enum {
    NAME_state_numbers = $STATE_NUMBERS,
    NAME_robot_numbers = $ROBOT_NUMBERS,
    NAME_channels = $CHANNELS,
    NAME_body_count = $BODY_COUNT
};

extern const double NAME_bodies[NAME_body_count][$SIZE_COUNT];

$PROTOTYPES
void NAME_predict(double state[$STATE_NUMBERS], const double robot[$ROBOT_NUMBERS],
                  const double current[3], const double servo_gain[$FINS], const double goal[3],
                  const double *commands, int count, int interval, double *seen);

#ifdef __cplusplus
}
#endif

#endif
