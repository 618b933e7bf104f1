"""The settings in which joint inference is measured, and what is asked of it in each."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

Bodies = Literal["inner", "prior", "edge"]
World = Literal[
    "plain", "other numbers", "prior", "reactive", "mujoco", "quarter", "law", "scale", "axes",
    "exponent", "centre", "hull", "double", "servo", "coloured", "dense",
]  # fmt: skip


@dataclass(frozen=True)
class Target:
    """What is asked of a setting: a number of the report and its bounds.

    ``what`` names an entry of the setting's part of the report, with dots for nested ones.
    """

    what: str
    low: float | None = None
    high: float | None = None


@dataclass(frozen=True)
class Setting:
    """Many random robots, all measured in one way; nuisances are always inferred.

    Attributes
    ----------
    title
        What it is, for the table.
    robots
        How many, at full size.
    bodies
        ``"inner"``: each size uniform in [0.1, 1] of its range. ``"prior"``: in [0, 1], as the
        inference assumes. ``"edge"``: inner, but one fin without length, or one of the greatest
        thickness, in turn.
    world
        ``"plain"``: as modelled, all nuisances nominal. ``"other numbers"``: the drag of the fins
        and that of the body 20% up or down each, a current of 0.15 units/s in any direction, and a
        servo gain of 0.95. ``"prior"``: every nuisance drawn from its prior. ``"reactive"``: the
        water also resists acceleration, and the hypothesis that says so is taken away.
        ``"mujoco"``: MuJoCo's own fluid. The others are in ``FOREIGN``.
    fast
        Whether the commands are the joint condition's own, corners of the range; else random ones.
    noise
        Standard deviation of the gyroscope's white noise, rad/s.
    asked
        What the setting is to show.
    """

    title: str
    robots: int
    bodies: Bodies = "inner"
    world: World = "plain"
    trials: int = 3
    steps: int = 256
    fast: bool = True
    noise: float = 0.01
    asked: tuple[Target, ...] = ()


COVERED = Target("coverage.90%.share", 0.86, 0.94)
MISSED = Target("missed", high=0.02)
QUIET = Target("alarms", high=0.02)  # of the goodness test, at a rate of 0.001 a trial
NOTICED = Target("alarms", low=0.95)

SETTINGS: dict[str, Setting] = {
    "exact": Setting(
        "no noise, random commands", 100, fast=False, noise=0.0,
        asked=(
            Target("rounds.1.exact", low=0.95), Target("rounds.2.exact", low=0.98),
            Target("rounds.3.exact", low=0.98),
        ),
    ),
    "quiet": Setting(
        "0.01 rad/s, 512 steps", 200, steps=512,
        asked=(
            Target("median", low=0.995), Target("close", low=0.95), COVERED, MISSED, QUIET,
        ),
    ),
    "loud": Setting(
        "0.03 rad/s, 512 steps", 200, steps=512, noise=0.03,
        asked=(Target("median", low=0.99), COVERED, MISSED, QUIET),
    ),
    "prior": Setting(
        "everything drawn from the prior", 200, "prior", "prior", steps=512,
        asked=(COVERED, MISSED, QUIET),
    ),
    "world": Setting(
        "drag ±20%, current 0.15, gain 0.95", 200, world="other numbers", steps=512,
        asked=(Target("median", low=0.99), COVERED, MISSED, QUIET),
    ),
    "edges": Setting(
        "a fin without length, or of the greatest thickness", 60, "edge",
        asked=(Target("named", low=0.9), MISSED, QUIET),
    ),
    "reactive": Setting(
        "reactive water, not imagined", 30, world="reactive", asked=(NOTICED,)
    ),
    "mujoco": Setting("MuJoCo's water", 30, world="mujoco", asked=(NOTICED,)),
}  # fmt: skip

#: Worlds that differ from the model, and that no nuisance describes.
FOREIGN: dict[World, str] = {
    "quarter": "PyBullet at a quarter of the step",
    "law": "MuJoCo's mechanics, our law over the whole surface",
    "scale": "gyroscope's scale 3% off",
    "axes": "gyroscope turned by 3 degrees",
    "exponent": "drag exponent 1.8 *",
    "centre": "centre of mass off by 0.1 *",
    "hull": "hull 20% heavier *",
    "double": "hull 100% heavier *",
    "servo": "servo time constant 0.1 s *",
    "coloured": "coloured noise, AR(1) of 0.9",
    "dense": "fins twice as dense, skin friction x 5 *",
}
FOREIGN_SETTINGS = {
    f"{world}-{noise:g}": Setting(
        title, 20, world=world, noise=noise, asked=(Target("trusted", low=0.8),)
    )
    for world, title in FOREIGN.items()
    for noise in (0.01, 0.03)
}
EVERY = {**SETTINGS, **FOREIGN_SETTINGS}
