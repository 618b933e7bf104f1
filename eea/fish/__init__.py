"""The bridge between the algorithms and the fish of ``aquafish_gym``.

The names below are imported when they are first used.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach(
    __name__,
    submod_attrs={
        "estimate": ["MorphologyEstimate"],
        "fins": ["fins_after"],
        "gap": ["RealityGap"],
        "known": ["infer_changes", "known_body", "watch_swim"],
        "log_checks": ["LogCheck", "check_log"],
        "log_inference": ["infer_log"],
        "methods": ["estimate_morphology", "estimate_morphology_of", "fish_eea"],
        "posterior_file": ["load_posterior", "save_posterior"],
        "simulator": ["EngineSimulator", "fish_problem"],
        "swim_log": ["SwimLog", "read_log", "write_log"],
        "target": ["EngineTarget"],
    },
)
