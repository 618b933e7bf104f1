"""The Estimation-Exploration Algorithm for robots that do not know where their fins are.

The algorithm, ``eea.core``, knows no robot: it asks a ``Target`` and a ``Simulator``, and needs
numpy only. ``eea.joint``, which needs scipy too, is the method beyond the paper: it infers body,
angles and nuisances together. ``eea.fish`` binds both to the fish of ``aquafish_gym``,
``eea.study`` repeats them in numbers. All but the core are loaded when first used.
"""

import lazy_loader

from eea import core, fish

__getattr__, __dir__, __all__ = lazy_loader.attach(
    __name__,
    submod_attrs={
        "core": core.__all__,
        "fish": fish.__all__,
        "joint.problem": ["Hypothesis", "Normal", "Nuisance"],
        "joint.observed": ["Trial"],
        "joint.robot": ["Robot"],
        "joint.session": ["JointInference"],
        "study.presets": ["FIGURES", "figure_config"],
    },
)
