"""The Estimation-Exploration Algorithm for any robot; it needs numpy alone.

A ``Problem`` describes the robot, a ``Target`` performs commands, a ``Simulator`` runs models, and
``EEA`` runs the algorithm. ``examples/toy_robot.py`` shows all four.
"""

from eea.core.algorithm import EEA
from eea.core.checks import ConfigurationError, TargetError
from eea.core.config import (
    CONDITIONS,
    FitConfig,
    JointConfig,
    PaperConfig,
    config_for,
    recovery_config,
)
from eea.core.experiment import (
    Performed,
    RecordedLog,
    RevealingTarget,
    Simulator,
    Target,
    Trials,
)
from eea.core.genome import BitLayout, Variable, action_layout, model_layout
from eea.core.problem import Problem
from eea.core.result import Result
from eea.core.session import streams

__all__ = [
    "CONDITIONS",
    "EEA",
    "BitLayout",
    "ConfigurationError",
    "FitConfig",
    "JointConfig",
    "PaperConfig",
    "Performed",
    "Problem",
    "RecordedLog",
    "Result",
    "RevealingTarget",
    "Simulator",
    "Target",
    "TargetError",
    "Trials",
    "Variable",
    "action_layout",
    "config_for",
    "model_layout",
    "recovery_config",
    "streams",
]
