"""All tuning numbers of the agent, in groups by what they decide.

Each is documented as ``unit: what it decides``. They are read where they are used, as
``NAME``; what follows from others is computed there. Settings that a user may choose are
:class:`~aquafish.online.config.AgentConfig`'s.
"""

from __future__ import annotations

import numpy as np

from aquafish_gym.utils.array_types import Floats

# The self-model's errors

#: rad, units/s, rad/s, rad: what the model's own error adds in an action to the standard deviations
#: of attitude, velocity, angular velocity and fin angles
MODEL_ERROR: Floats = np.array([1e-5, 1e-4, 1e-4, 1e-5])
#: as MODEL_ERROR: the least of it after a robot was recognised, whose numbers are not exact
RECOGNISED_ERROR: Floats = np.array([1e-4, 1e-3, 1e-3, 5e-4])
#: as MODEL_ERROR: of the state at the start; a robot at rest moves against water that may flow
START_ERROR: Floats = np.array([1e-4, 0.2, 1e-4, 1e-4])
#: 1 or rad/s: standard deviation of an observation without noise, for rounding and single precision
LEAST_OBSERVATION_SD = 2e-4

# Calibrating

#: actions: how long the calibration takes; for as long there is no alarm after one in foreign
#: water, or after "unknown"
CALIBRATION_ACTIONS = 50
#: actions: when the water's kind is chosen
WATER_ACTIONS = 25
#: actions: after how many, with readings, unknown fin angles are estimated
FIN_ANGLE_ACTIONS = 5
#: number: of angles of each fin from which its initial one is narrowed
POSES_PER_FIN = 16
#: rad: standard deviation of the estimated fin angles
FIN_ANGLE_ERROR = 0.2
#: factor: on MODEL_ERROR; the filters that compete with one of that error. Beyond the first, the
#: water counts as foreign
ERROR_SCALES = (10.0, 100.0, 1000.0)
#: factor: on the fins' drag; the filters that compete in foreign water
DRAGS = (0.3, 0.4, 0.5, 0.6, 0.8, 1.0, 1.3)
#: units/s: standard deviation of a wandering current's change in an action
WANDERING_SPEED = 0.01
#: factor: on the measured drift where a current wanders; in another place it may wander faster
WANDERING_MARGIN = 2.0
#: actions: after which a filter has forgotten its initial state, and its likelihood counts
SETTLED_ACTIONS = 10
#: actions: length of an open-loop prediction, from which the model's drift is measured; half of it
#: is from one to the next
PREDICTED_ACTIONS = 10
#: share: of the gyroscope's rms; if the drift is below, the model predicts in foreign water
PREDICTED_SHARE = 0.3
#: standard deviations: beyond which a single reading is ignored as a glitch
GLITCH_SDS = 10.0

# Noticing

#: actions: lengths of the windows in which squared innovations are summed
WINDOWS = (1, 2, 4, 8, 16)
#: probability: of a false alarm in an action and window, if the model has no error
ALARM_PROBABILITY = 1e-7
#: factor: on the largest sum before anything broke, which an alarm must exceed
SURPRISE_MARGIN = 2.0
#: factor: the same in foreign water
FOREIGN_SURPRISE_MARGIN = 5.0
#: actions: after which the whole robot may be watched during the calibration
KNOWN_ACTIONS = 5
#: observations: with which damage from the start is tried
START_INFERENCES = (10, 15, 20, 30, 40)
#: factor: on LEAST_OBSERVATION_SD; the drift that is assumed before it is measured
EARLY_DRIFT_RATIO = 5.0

# Which moments explain an alarm

#: actions: before an alarm, in which the robot may have broken
ACTIONS_BEFORE_ALARM = 2
#: actions: the same if the gyroscope is the only sensor
ACTIONS_BEFORE_GYRO_ALARM = 5
#: actions: from a mild fault to its alarm, at most; looked at if nothing fitted, not counted in the
#: calibration of a watched filter, and awaited until all filters are surprised
LONGEST_DELAY_ACTIONS = 5
#: actions: without any reading before an alarm, in which it may have broken, too
OUTAGE_ACTIONS = 10
#: actions: after an alarm, from which on another one means another fault
SETTLED_CASE_ACTIONS = 10
#: actions: after an alarm, within which another one may mean that its fault was wrong
REOPENED_ACTIONS = 25
#: observations: most of an inference in foreign water, where predictions are good for seconds
MOST_FOREIGN_OBSERVATIONS = 12
#: observations: most of an inference where a current wanders
MOST_WANDERING_OBSERVATIONS = 8
#: starts: of the simulation that one thinking time pays for
CHARGED_STARTS = 3

# Recognising: search

#: actions: over which all hypotheses are compared
COMPARED_ACTIONS = 8
#: nats: minus the log prior of a fault
WORD_COST = 2.0
#: nats: minus the log prior of a number of a fault
NUMBER_COST = 1.0
#: 1: distance of a number from one that is another hypothesis
NUMBER_MARGIN = 0.02
#: number: of hypotheses that are narrowed in the first two rounds
NARROWED_HYPOTHESES = 16
#: number: of hypotheses that are narrowed in later rounds
LATE_HYPOTHESES = 4
#: number: of rounds
NARROWING_ROUNDS = 6
#: spacings: of the numbers that are tried about one
STENCIL = (-1.0, -1 / 3, 0.0, 1 / 3, 1.0)
#: 1: first spacing of the numbers that are tried
FIRST_SPACING = 0.12
#: factor: from the spacing in a round to that in the one before
SPACING_RATIO = 2.6
#: number: of pairs of words to which a third fault is added
THIRD_PAIRS = 24
#: number: of hypotheses of three faults that take a first, second ... Gauss-Newton step
THIRD_DESCENTS = (48, 24, 12, 8, 4, 4)
#: 1: difference of a number, over which a slope is measured
NUMBER_DIFFERENCE = 0.01
#: factor: on a Gauss-Newton step; the lengths that are tried
STEP_LENGTHS = (0.1, 0.3, 0.6, 1.0)
#: nats: minus the log prior of a current that begins, or that wanders
CURRENT_COST = 10.0
#: units/s: difference of a current, over which a slope is measured
CURRENT_DIFFERENCE = 0.02
#: number: of Gauss-Newton steps from no current, at most
CURRENT_DESCENTS = 6
#: units/s: a shorter step is the last
CURRENT_PRECISION = 0.002

# Recognising: all sizes and servo gains at once

#: readings: from an alarm on, fewest with which they are fitted; five observations of all channels
IDENTIFIED_READINGS = 45
#: 1: standard deviation of the prior of the logarithm of a factor on a size, and of a factor on a
#: gain
CHANGE_SD = 0.6
#: factor: on the curvature's diagonal; Levenberg-Marquardt steps that are tried side by side
DAMPINGS = (0.0, 0.01, 0.1, 1.0, 10.0, 100.0)
#: number: of steps, at most
IDENTIFYING_STEPS = 30
#: nats: a step that gains less is the last
STEP_NATS = 0.3
#: observations: after the last onset, that are fitted first, second ... and all in the end
FIRST_IDENTIFIED = (3, 6, 10)

# Recognising: sensors

#: 1 or rad/s: the least rms error of a broken channel
CHANNEL_TOLERANCE = 0.02
#: factor: on a channel's drift, and on the gyroscope's noise; the least rms error of a broken one
TOLERANCE_RATIO = 3.0
#: nats: minus the log prior of a bias
BIAS_COST = 4.0
#: factor: from the expected error to the least bias below the tolerance
BIAS_RATIO = 5.0
#: share: of their mean; errors that deviate less from it are a bias
BIAS_DEVIATION = 0.3
#: observations: fewest that show a bias or a stuck channel, or anything in foreign water; a channel
#: that misses as many readings is reported
FEWEST_OBSERVATIONS = 3
#: correlation: of errors with those before; noise has less
NOISE_CORRELATION = 0.4
#: share: of a channel's tolerance; less error of the model does not count as noise
TOLERATED_NOISE = 0.25

# Belief and doubt

#: square roots of N: by which a sum of N squared errors, in standard deviations, may exceed N; it
#: is N +- 1.4 sqrt(N) by chance
NOISE_EXCESS = 5.0
#: factor: on the expected rms error; a true hypothesis leaves less
FIT_MARGIN = 1.5
#: share: of the channels; if more than one and than this are odd, nothing is explained
MOST_ODD_SHARE = 1 / 3
#: factor: by which broken fins must be likelier than a current, or nothing
DECIDED_RATIO = 1000.0
#: observations: fewest that show noise, or a bias below the tolerance; what fits as many is trusted
CONFIRMING_OBSERVATIONS = 8
#: factor: on the model's error at each alarm after the first
ERROR_GROWTH = 3.0
#: units or 1: difference of sizes, and of gains, of robots that need no other gait
SAME_GAIT_DIFFERENCE = 0.05

# Choosing a gait

#: s: left of an episode, for which a gait is still refined, or chosen again in foreign water
SHORTEST_SWIM_SECONDS = 2.0
#: s: longest swim over which gaits are compared; a longer one does not end within the thinking time
LONGEST_COMPARISON_SECONDS = 60.0
#: number: of its own refined gaits, the latest, among which it chooses beside the library's
REFINED_GAITS = 8
#: number: of phases of its clock in which a teacher stands among the gaits
TEACHER_PHASES = 8
#: s: between two choices in foreign water
CHOOSE_AGAIN_SECONDS = 3.0
#: s: over which gaits are compared in foreign water
AHEAD_SECONDS = 10.0
#: share: of the way, which a change of gait must gain in foreign water
LEAST_GAIN = 0.04

# Refining a gait

#: number: of nodes of a network that CMA-ES refines in a second, at most
MAXIMUM_REFINED_NODES = 30
#: number: of controllers in a generation
CONTROLLER_POPULATION = 24
#: number: of a teacher's gaits in a generation
TEACHER_POPULATION = 32
#: standard deviations: of a teacher's numbers; initial step of a first refinement
TEACHER_FIRST_SIGMA = 0.5
#: standard deviations: the same of a later refinement
TEACHER_LATER_SIGMA = 0.3
#: actions: of a swim for which a number of generations of the teacher is meant
BUDGET_ACTIONS = 200
#: factor: of the generations of a shorter swim to those that are meant, at most
MOST_GENERATIONS_RATIO = 3
#: 1, rad: standard deviations of the numbers that are added to a teacher: an offset of each action,
#: the logarithm of the clock's frequency, a turn (yaw) and a pitch of the perceived course, and the
#: phase of the clock
TEACHER_NUMBER_SCALES = (0.1, 0.05, 0.1, 0.1, 0.5)
