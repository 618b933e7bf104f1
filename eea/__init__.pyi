from .core import *  # noqa: F403
from .fish import *  # noqa: F403
from .infer.robot import Robot as Robot
from .infer.session import JointInference as JointInference
from .infer.simulating import one_by_one as one_by_one
from .infer.statement import Hypothesis as Hypothesis
from .infer.statement import Number as Number
from .infer.trials import Trial as Trial
from .logs.trials import read_trials as read_trials
from .study.arms import FIGURES as FIGURES
from .study.arms import figure_config as figure_config
