"""Joint inference: all unknowns of all trials fitted together, with honest intervals.

It knows no robot, and needs numpy and scipy only.
"""

from eea.joint.calibration import Coverage, coverage, rank_uniformity, ranks
from eea.joint.findings import Group, findings
from eea.joint.goodness import Goodness, effective_count, goodness_of_fit
from eea.joint.posterior import Mode, Posterior

__all__ = [
    "Coverage",
    "Goodness",
    "Group",
    "Mode",
    "Posterior",
    "coverage",
    "effective_count",
    "findings",
    "goodness_of_fit",
    "rank_uniformity",
    "ranks",
]
