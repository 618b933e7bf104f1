"""The Estimation-Exploration Algorithm for robots that do not know where their fins are.

The algorithm, ``eea.core``, contains no robot: it calls a ``Target`` and a ``Simulator``, and needs
numpy only. ``eea.infer``, the method beyond the paper, infers body, angles and nuisances together,
and also needs scipy. ``eea.fish`` binds both to the fish of ``aquafish_gym``. ``eea.study`` runs
many replicates. All packages except the core are loaded when first used.
"""

from importlib.util import find_spec

import lazy_loader

from eea import core, fish

for _name in ("matplotlib", "pandas", "scipy"):
    if find_spec(_name) is None:
        from aquafish_gym.utils.validation import MissingExtraError, install_advice

        raise MissingExtraError(f"eea needs {_name}: {install_advice('eea')}")

__getattr__, __dir__, __all__ = lazy_loader.attach(
    __name__,
    submod_attrs={
        "core": core.__all__,
        "fish": fish.__all__,
        "infer.simulating": ["one_by_one"],
        "infer.session": ["JointInference"],
        "infer.robot": ["Robot"],
        "infer.statement": ["Hypothesis", "Number"],
        "infer.trials": ["Trial"],
        "logs.trials": ["read_trials"],
        "study.arms": ["FIGURES", "figure_config"],
    },
)
