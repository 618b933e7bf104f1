"""A study's arms for readers: their names, their order, and which are compared with which."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence

from eea.study.presets import FIGURE_ARMS

BASELINE = "baseline"  # what ablations are held against; begins the names of such arms
# The paper's arms in its order, and their figures' names; other arms follow, by name.
FIGURES = {arm: f"fig{number}" for number, arm in FIGURE_ARMS.items()}
LABELS = {
    "ideal": "Ideal",
    "none": "None",
    "in-band": "In-Band",
    "in-band-200": "In-Band, {models} models",
    "in-band-split": "In-Band, dynamic split",
    "in-band-extended": "In-Band, wider range",
    "out-of-band": "Out-of-Band",
    "out-of-band-100": "Out-of-Band, {models} models",
    "joint": "Joint",
}
# First less second, where a study has both.
COMPARISONS = (
    ("joint", "out-of-band"),
    ("ideal", "out-of-band"),
    ("out-of-band", "in-band"),
    ("in-band", "none"),
    ("out-of-band-100", "out-of-band"),
    ("in-band-200", "in-band"),
    ("in-band-split", "in-band"),
    ("in-band-extended", "in-band"),
)


def is_baseline(arm: str) -> bool:
    """Return whether an arm is what ablations are held against."""
    return arm == BASELINE or arm.startswith(f"{BASELINE}-")


def condition_of(baseline: str, arm: str) -> str:
    """Return the condition that both names end with, empty if there is none."""
    condition = baseline.removeprefix(BASELINE)[1:]
    return condition if condition and arm.endswith(f"-{condition}") else ""


def arm_label(arm: str, models: int | None = None) -> str:
    """Return an arm's name as a reader knows it; ``models`` is how many it has, if known."""
    if arm != BASELINE and is_baseline(arm):
        return f"{arm_label(arm.removeprefix(f'{BASELINE}-'), models)} (baseline)"
    label = LABELS.get(arm, arm)
    if "{models}" in label and models is None:
        return arm
    return label.replace("{models}", str(models))


def setting_label(arm: str, baseline: str, labels: Mapping[str, str]) -> str:
    """Return an ablation's name without the condition that it shares with its baseline."""
    condition = condition_of(baseline, arm)
    short = condition and arm != baseline
    return arm.removesuffix(f"-{condition}") if short else labels[arm]


def angle_label(label: str, condition: str) -> str:
    """Return an arm's name beside its angles, which the condition None does not infer."""
    return f"{label} (assumes zero)" if condition == "none" else label


def arm_order(arm: str) -> tuple[bool, int, str]:
    """Return a sort key: baselines first, then the paper's order, then names."""
    order, name = list(FIGURES), arm.removeprefix(f"{BASELINE}-")
    return (not is_baseline(arm), order.index(name) if name in order else len(order), arm)


def baseline_of(arm: str, arms: Iterable[str]) -> str | None:
    """Return which of the arms an ablation is held against, None if it is no ablation.

    ``clamp-degrees-ideal`` is held against ``baseline-ideal``, and any arm against ``baseline``.
    """
    if is_baseline(arm):
        return None
    baselines = [other for other in arms if is_baseline(other)]
    fitting = [other for other in baselines if condition_of(other, arm)]
    return max(fitting, key=len, default=BASELINE if BASELINE in baselines else None)


def shown_in_full(arms: Sequence[str]) -> list[str]:
    """Return the arms that are no ablations; of these, the differences say enough."""
    return [arm for arm in arms if baseline_of(arm, arms) is None]


def comparisons(arms: Sequence[str]) -> list[tuple[str, str]]:
    """Return which arms are compared, first less second.

    Besides the conditions these are variants: an arm whose name goes on after another's.
    """
    pairs = [(first, second) for first, second in COMPARISONS if {first, second} <= set(arms)]
    for arm in shown_in_full(arms):
        plain = [other for other in arms if arm.startswith(f"{other}-")]
        if arm not in dict(pairs) and not is_baseline(arm) and plain:
            pairs.append((arm, max(plain, key=len)))
    return pairs
