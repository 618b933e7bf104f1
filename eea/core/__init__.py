"""The Estimation-Exploration Algorithm for any robot; numpy and the standard library only.

A robot is described by a ``Problem``, performs as a ``Target`` and is modelled by a
``Simulator``; ``EEA`` does the rest. ``examples/toy_robot.py`` shows all four.
"""

from eea.core.algorithm import EEA
from eea.core.bits import BitLayout, Variable, action_layout, model_layout
from eea.core.checks import ConfigurationError, TargetError
from eea.core.config import CONDITIONS, RECOMMENDED, EEAConfig, JointConfig, recovery_config
from eea.core.experiment import Performed, RevealingTarget, Simulator, Target, Trials
from eea.core.problem import Problem
from eea.core.replay import RecordedLog, ReplayTarget
from eea.core.result import Result
from eea.core.session import streams

__all__ = [
    "CONDITIONS",
    "EEA",
    "RECOMMENDED",
    "BitLayout",
    "ConfigurationError",
    "EEAConfig",
    "JointConfig",
    "Performed",
    "Problem",
    "RecordedLog",
    "ReplayTarget",
    "Result",
    "RevealingTarget",
    "Simulator",
    "Target",
    "TargetError",
    "Trials",
    "Variable",
    "action_layout",
    "model_layout",
    "recovery_config",
    "streams",
]
