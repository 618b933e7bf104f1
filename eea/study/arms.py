"""The arms of a study: a table of the conditions, and what reports call, draw and compare."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import product
from typing import Any

from aquafish_gym.runs.manifest import flat
from eea.core.checks import ConfigurationError, choice
from eea.core.config import (
    EstimationConfig,
    JointConfig,
    OutOfBandConfig,
    PaperConfig,
    check_read,
    reads,
    recovery_config,
    with_settings,
)
from eea.study.method import ArmConfig, MethodConfig

MINUS = "\u2212"


@dataclass(frozen=True)
class Arm:
    """An arm of a study: its settings, and how reports show it."""

    name: str
    label: str  #: For readers; ``{models}`` stands for the number of models.
    config: ArmConfig
    colour: str
    dash: Any  #: Line style of matplotlib.
    compared_with: tuple[str, ...] = ()  #: Arms that are subtracted from it in pairs.
    figure: int | None = None  #: Number of its figure in the paper.
    varied: Mapping[str, Any] = field(default_factory=dict)  #: Settings that differ between arms.
    row: str = ""  #: The arm of the table, or the method, that it is a variant of.

    @property
    def is_method(self) -> bool:
        """Whether it is a method of one's own."""
        return self.config.condition == MethodConfig.condition

    @property
    def infers_angles(self) -> bool:
        """Whether it has an estimate of the hidden angles that can be wrong."""
        return not self.is_method and self.config.condition != "ideal"


# In the order of reports: the paper's figures, then the others. The colours are Okabe and Ito's,
# which colour-blind readers can tell apart, a wine red and a brown.
ARMS: dict[str, Arm] = {
    arm.name: arm
    for arm in (
        Arm("ideal", "Ideal", PaperConfig("ideal"), "#009E73", "-", ("out-of-band",), 5),
        Arm("none", "None", PaperConfig("none"), "#D55E00", "--", (), 6),
        Arm("in-band", "In-Band", PaperConfig("in-band"), "#CC79A7", "-.", ("none",), 7),
        Arm(
            "in-band-200",
            "In-Band, {models} models",
            PaperConfig("in-band", estimation=EstimationConfig(population=200)),
            "#E69F00",
            ":",
            ("in-band",),
            8,
        ),
        Arm(
            "out-of-band",
            "Out-of-Band",
            PaperConfig("out-of-band"),
            "#0072B2",
            (0, (5, 1, 1, 1, 1, 1)),
            ("in-band",),
            9,
        ),
        Arm(
            "out-of-band-100",
            "Out-of-Band, {models} models",
            PaperConfig(
                "out-of-band",
                estimation=EstimationConfig(population=100),
                out_of_band=OutOfBandConfig(inner_population=50, sampled_models=5),
            ),
            "#56B4E9",
            (0, (3, 1)),
            ("out-of-band",),
            10,
        ),
        Arm("joint", "Joint", JointConfig(), "#882255", (0, (8, 1)), ("out-of-band",)),
        Arm("recovery", "Recovery", recovery_config(), "#8C510A", (0, (1, 1)), ("out-of-band",)),
    )
}
FIGURE_ARMS = {str(arm.figure): arm for arm in ARMS.values() if arm.figure is not None}
FIGURES = {f"fig{number}": arm.config for number, arm in FIGURE_ARMS.items()}
# Further arms of one condition, and methods of one's own.
DASHES = ("-", "--", ":", "-.", (0, (6, 1, 1, 1)))
METHOD_COLOURS = ("#000000", "#999933", "#44AA99", "#AA4499")


def figure_config(name: str, steps: int = 256, rounds: int = 25) -> PaperConfig:
    """Return the settings of ``FIGURES`` behind one of the paper's figures.

    The paper's figures have steps of 128 to 1024 and 25 rounds.

    Raises
    ------
    ConfigurationError
        If the name is unknown.
    """
    choice("figure", name, FIGURES)
    config = FIGURES[name]
    assert isinstance(config, PaperConfig)
    return replace(config, steps=steps, rounds=rounds)


def variants(
    arms: Mapping[str, ArmConfig], settings: Mapping[str, Sequence[Any]]
) -> dict[str, ArmConfig]:
    """Return the arms with an arm for each combination of values of the settings.

    Parameters
    ----------
    arms
        Settings by name of the arm.
    settings
        Values by name of a setting, such as ``{"in_band.best": (3, 5)}``. An arm whose condition
        does not read a setting stays as it is.

    Raises
    ------
    ConfigurationError
        If no arm reads a setting, values are missing or equal, or a value is wrong.

    Examples
    --------
    >>> list(variants({"in-band": PaperConfig("in-band")}, {"in_band.best": (3, 5)}))
    ['in-band-best-3', 'in-band-best-5']
    """
    check_read(settings, {config.condition for config in arms.values()})
    for name, values in settings.items():
        if not values or len(set(values)) < len(values):
            raise ConfigurationError(f"{name} must have values that differ; got {values}")
    found = {}
    for arm, config in arms.items():
        read = {name: values for name, values in settings.items() if reads(config.condition, name)}
        for chosen in product(*read.values()):
            named = [
                f"{setting_words(name)} {_shown(value)}".replace(" ", "-")
                for name, value in zip(read, chosen, strict=True)
                if len(read[name]) > 1
            ]
            with_own = with_settings(config, dict(zip(read, chosen, strict=True)))
            found["-".join([arm, *named])] = with_own
    return found


def study_arms(settings: Mapping[str, Mapping[str, Any]], rounds: int) -> dict[str, Arm]:
    """Return the arms of a study.json, in the order of reports.

    ``settings`` are those of the arms by name; an arm without "rounds" has ``rounds``. Arms of one
    row of the table are named by the settings in which they differ.
    """
    groups: dict[str, list[str]] = {}
    for name, own in settings.items():
        groups.setdefault(_row(name, own["condition"], own.get("function")), []).append(name)
    found: list[Arm] = []
    for row, names in groups.items():
        values = [flat({"rounds": rounds, **settings[name]}) for name in names]
        varied = [key for key in values[0] if len({json.dumps(own.get(key)) for own in values}) > 1]
        others = len({before.row for before in found} - ARMS.keys())
        for i, (name, own) in enumerate(zip(names, values, strict=True)):
            base = ARMS.get(row) or _another(name, settings[name], others)
            arm = replace(
                base,
                name=name,
                row=row,
                label=base.label.format(models=own.get("estimation.population", "more"))
                + "".join(f", {setting_words(key)} {_shown(own.get(key))}" for key in varied)
                + _changed_choices(own, varied),
                config=replace(base.config, rounds=own["rounds"]),
                dash=DASHES[i % len(DASHES)] if i else base.dash,
                figure=base.figure if name == row else None,
                varied={key: own.get(key) for key in varied},
            )
            found.append(arm)
    order = list(ARMS)
    found.sort(key=lambda arm: order.index(arm.row) if arm.row in order else len(order))
    return {arm.name: arm for arm in found}


def comparisons(arms: Sequence[Arm]) -> list[tuple[str, str]]:
    """Return the names of the pairs of arms to compare, first minus second.

    Arms of one row are compared with its first. Arms of two rows are compared if they agree in
    every setting that both vary. A method of one's own is compared with every other arm.
    """
    rows = [arm.row for arm in arms]
    pairs = []
    for i, first in enumerate(arms):
        for j, second in enumerate(arms):
            shared = first.varied.keys() & second.varied.keys()
            agree = all(first.varied[key] == second.varied[key] for key in shared)
            if rows[i] == rows[j]:
                compared = j == rows.index(rows[i]) < i
            elif first.is_method:
                compared = agree and (not second.is_method or j < i)
            else:
                compared = agree and rows[j] in first.compared_with
            if compared:
                pairs.append((first.name, second.name))
    return pairs


def _row(name: str, condition: str, function: str | None) -> str:
    """Return the arm of the table, or the method, that an arm is a variant of, or its own name."""
    rows = [
        row
        for row, arm in ARMS.items()
        if arm.config.condition == condition and (name == row or name.startswith(f"{row}-"))
    ]
    return function or max(rows, key=len, default=name)


def _another(name: str, settings: Mapping[str, Any], place: int) -> Arm:
    """Return an arm that is not in the table, such as a method of one's own."""
    condition = settings["condition"]
    label = name
    if condition == MethodConfig.condition:
        config: ArmConfig = MethodConfig(settings["function"], settings["code"])
        label = spoken(settings["function"].rpartition(":")[2]).capitalize()
    else:
        config = next(arm.config for arm in ARMS.values() if arm.config.condition == condition)
    return Arm(name, label, config, METHOD_COLOURS[place % len(METHOD_COLOURS)], "-")


def _changed_choices(settings: Mapping[str, Any], named: Sequence[str]) -> str:
    """Return an arm's choices that are not the defaults, such as ``, best 5``, for its name.

    ``settings`` are flat. Sizes of searches, which presets change, and the settings in ``named``
    are left out.
    """
    usual = flat(PaperConfig().to_dict())
    return "".join(
        f", {setting_words(name)} {_shown(value)}"
        for name, value in settings.items()
        if name.partition(".")[0] in ("exploration", "genetic", "in_band")
        and name not in named
        and value != usual.get(name, value)
        and name.rpartition(".")[2] not in ("population", "generations")
    )


def setting_words(name: str) -> str:
    """Return ``best`` for ``in_band.best``; only sizes of populations keep the name of the part."""
    field_name = name.rpartition(".")[2]
    return spoken(name if field_name in ("population", "generations") else field_name)


def _shown(value: Any) -> str:
    """Return a value for names and labels."""
    if isinstance(value, float):
        return f"{value:g}"
    return str(value)


def angle_label(arm: Arm) -> str:
    """Return an arm's name for a plot of angles; the condition None does not infer them."""
    return f"{arm.label} (assumes zero)" if arm.config.condition == "none" else arm.label


def spoken(name: str) -> str:
    """Return ``left pectoral width`` for ``left_pectoral.width``."""
    return name.replace("_", " ").replace(".", " ")


def duration_name(durations: Sequence[int]) -> str:
    """Return ``256 steps``, or ``mean of 4 durations``."""
    return f"{durations[0]} steps" if len(durations) == 1 else f"mean of {len(durations)} durations"


def signed(value: float) -> str:
    """Return a number to three decimals with its sign, with a real minus."""
    return f"{value:+.3f}".replace("-", MINUS)
