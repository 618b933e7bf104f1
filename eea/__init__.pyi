from .core import *  # noqa: F403
from .fish import *  # noqa: F403
from .joint.observed import Trial as Trial
from .joint.problem import Hypothesis as Hypothesis
from .joint.problem import Nuisance as Nuisance
from .joint.robot import Robot as Robot
from .joint.session import JointInference as JointInference
from .statistics.normal import Normal as Normal
from .study.presets import FIGURES as FIGURES
from .study.presets import figure_config as figure_config
