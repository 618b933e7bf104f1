"""The arms of a study in reports: names, order, and compared pairs."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from eea.core.config import PaperConfig
from eea.study.presets import FIGURE_ARMS

# The paper's arms in its order, and the names of their figures; other arms follow, by name.
FIGURE_NAMES = {arm: f"fig{number}" for number, arm in FIGURE_ARMS.items()}
ARM_LABELS = {
    "ideal": "Ideal",
    "none": "None",
    "in-band": "In-Band",
    "in-band-200": "In-Band, {models} models",
    "out-of-band": "Out-of-Band",
    "out-of-band-100": "Out-of-Band, {models} models",
    "joint": "Joint",
}
MINUS = "\u2212"
# Pairs of arms that are compared, first minus second, where a study has both.
ARM_COMPARISONS = (
    ("joint", "out-of-band"),
    ("ideal", "out-of-band"),
    ("out-of-band", "in-band"),
    ("in-band", "none"),
    ("out-of-band-100", "out-of-band"),
    ("in-band-200", "in-band"),
)


def arm_label(arm: str, models: int | None = None) -> str:
    """Return an arm's name for readers; ``models`` is its population, if known."""
    label = ARM_LABELS.get(arm, arm)
    return arm if "{models}" in label and models is None else label.format(models=models)


def changed_choices(settings: Mapping[str, Any]) -> str:
    """Return an arm's choices that are not the defaults, such as ``, best 5``, for its name.

    ``settings`` are those of study.json. Sizes of searches, which presets change, are left out.
    """
    usual = PaperConfig().to_dict()
    return "".join(
        f", {spoken(name)} {value}"
        for part in ("exploration", "genetic", "in_band")
        for name, value in settings.get(part, {}).items()
        if value != usual[part].get(name, value) and name not in ("population", "generations")
    )


def angle_label(label: str, condition: str) -> str:
    """Return an arm's name for a plot of angles; the condition None does not infer them."""
    return f"{label} (assumes zero)" if condition == "none" else label


def spoken(name: str) -> str:
    """Return ``left pectoral width`` for ``left_pectoral.width``."""
    return name.replace("_", " ").replace(".", " ")


def arm_order(arm: str) -> tuple[int, str]:
    """Return a sort key: the paper's order, then names."""
    order = list(FIGURE_NAMES)
    return (order.index(arm) if arm in order else len(order), arm)


def comparisons(arms: Sequence[str]) -> list[tuple[str, str]]:
    """Return the pairs of arms to compare, first minus second."""
    return [pair for pair in ARM_COMPARISONS if set(pair) <= set(arms)]


def duration_name(durations: Sequence[int]) -> str:
    """Return ``256 steps``, or ``mean of 4 durations``."""
    return f"{durations[0]} steps" if len(durations) == 1 else f"mean of {len(durations)} durations"


def signed(value: float) -> str:
    """Return a number to three decimals with its sign, with a real minus."""
    return f"{value:+.3f}".replace("-", MINUS)
