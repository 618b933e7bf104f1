/* Written by `aquafish export`: a policy of stable-baselines3, learned by $KIND.
 *
 * $DESCRIPTION
 *
 * Include this file where you call it, compile NAME.c with your program, and link with -lm:
 *
//? bounds
 *     float action[NAME_actions];
 *     NAME_act(observation, action);
 *
 * observation  $INPUTS numbers, as the environment returns them: flattened by rows$SCALED.
 * action       $ACTIONS numbers between NAME_low and NAME_high, as the environment takes them.
//.
//? choice
 *     int action = NAME_act(observation);
 *
 * observation  $INPUTS numbers, as the environment returns them: flattened by rows$SCALED.
 * action       one of $ACTIONS choices, from 0 on, as model.predict returns it.
//.
 *
 * The action is the policy's own, without exploration. A NaN in the observation is not held back.
 */
#ifndef NAME_H_$EXPORT
#define NAME_H_$EXPORT

#ifdef __cplusplus
extern "C" {
#endif

enum {
    NAME_inputs = $INPUTS,
    NAME_actions = $ACTIONS
};

//? bounds
extern const float NAME_low[NAME_actions];
extern const float NAME_high[NAME_actions];

void NAME_act(const float observation[NAME_inputs], float action[NAME_actions]);
//.
//? choice
int NAME_act(const float observation[NAME_inputs]);
//.

#ifdef __cplusplus
}
#endif

#endif
