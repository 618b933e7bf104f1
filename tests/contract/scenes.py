"""What the faces of the environments swim, drawn by hypothesis."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from hypothesis import strategies as st
from numpy.typing import NDArray

from aquafish_gym.envs.autoreset import AutoresetMode
from aquafish_gym.envs.tasks import TASKS, ReturnToBuoys, Step, SwimForward
from aquafish_gym.plans import AQUAFISH, BodyPlan

COUNT = 3
MODES = list(AutoresetMode)
# One start in twelve of this body diverges within a second in this current, that of seed 10, too.
THIN = (1.0, 2.0, 0.0, 0.0, 2.0, 0.5, 0.5, 0.0, 0.0)
ROUGH = (20.0, 20.0, 20.0)
BEFORE_DIVERGING_SEED = 9

channels = st.sampled_from(["up_x", "north_y", "gyro_x", "gyro_z"])
shares = st.sampled_from([0.3, 0.5, 0.8])
late = st.sampled_from([1.3, 2.0, 3.0])  # time steps


@dataclass(frozen=True)
class Counting(SwimForward):
    """A task of one's own, in which each robot succeeds after a number of steps of its own."""

    def begin(self, rng: np.random.Generator) -> tuple[float, ...]:
        """Return the number, and how many steps were taken."""
        return (float(rng.integers(2, 6)), 0.0)

    def remember(self, step: Step) -> Any:
        """Count this step."""
        return (step.memory[0], np.asarray(step.memory[1]) + 1.0)

    def succeeded(self, step: Step) -> Any:
        """Return whether this step is the last."""
        return np.where(np.asarray(step.memory[1]) + 1.0 >= np.asarray(step.memory[0]), 1.0, 0.0)


#: So near, and in so little current, that the tail alone reaches the line within seconds.
NEAR = ReturnToBuoys(seconds=6.0, pace=0.003, slowest=0.0, fastest=0.001)
#: How an episode ends, and the tasks that end so.
ENDS: dict[str, tuple[SwimForward | ReturnToBuoys | Any, ...]] = {
    "time": tuple(TASKS.values()),
    "success": (NEAR, Counting()),
    "divergence": (TASKS["forward"], TASKS["waypoint"]),
}


@dataclass(frozen=True)
class Scene:
    """The robots' options, and how they are swum."""

    options: dict[str, Any]  #: Of all robots, as ``gym.make`` takes them.
    damages: tuple[str, ...]
    mode: AutoresetMode
    limit: int  #: Steps of an episode.
    seed: int
    steers: str = "at random"  #: Or "to the buoys", all but the last robot; or "steadily".
    size: int = 3  #: Of an action.

    @property
    def actions(self) -> NDArray[np.float32]:
        """(steps, COUNT, size), of which some are clipped."""
        shape = (2 * self.limit + 5, COUNT, self.size)
        found = np.random.default_rng(self.seed).uniform(-1.2, 1.2, shape)
        if self.steers == "to the buoys":
            found = 0.2 * found
            found[..., -1] = 1.0  # by the tail
            found[:, -1, -1] = -1.0
        elif self.steers == "steadily":
            found[:] = [0.3, 0.5, 0.9, 0.7][: self.size]
        return found.astype(np.float32)


@st.composite
def damages(draw: st.DrawFn, dt: float, limit: int, plan: BodyPlan = AQUAFISH) -> str:
    """Return damage of one robot, whose faults begin before an episode of some steps ends."""
    fins = st.sampled_from(plan.names)
    step = st.sampled_from([0.0, 1.0, 1.6, limit - 1.0])
    found = []
    for _ in range(draw(st.integers(0, 3))):
        lateness = draw(late) * dt
        word = draw(
            st.one_of(
                st.builds("{}:length={}".format, fins, shares),
                st.builds("{}:missing".format, fins),
                st.builds("{}:weak={}".format, fins, shares),
                st.builds("{}:scale={}".format, fins, shares),
                st.builds("{}:seized".format, fins),
                st.builds("{}:reversed".format, fins),
                st.builds("{}:dead".format, fins),
                st.builds("{}:entangled={}".format, fins, shares),
                st.builds("{}:delay={:.4g}".format, fins, st.just(lateness)),
                st.builds("{}:hold={:.4g}".format, fins, st.just(lateness)),
                st.builds("{}:bias={}".format, channels, shares),
                st.builds("{}:stuck".format, channels),
                st.builds("{}:dropped".format, channels),
                st.builds("{}:scale={}".format, channels, shares),
                st.builds("{}:delay={:.4g}".format, channels, st.just(lateness)),
                st.builds("{}:hold={:.4g}".format, channels, st.just(lateness)),
                st.just("gyro:noise=0.05"),
            )
        )
        onset = f"@{draw(step) * dt:.4g}"
        if draw(st.booleans()):
            onset += f"+{draw(st.sampled_from([1.0, 2.5])) * dt:.4g}"
        elif "weak" in word or "bias" in word:
            onset += f"~{2 * dt:.4g}" * draw(st.booleans())
        found.append(word + onset)
    if draw(st.integers(0, 4)) == 0:
        found.append(f"random:severe@0-{(limit - 1) * dt:.4g}")
    return "; ".join(found) or "none"


@st.composite
def scenes(
    draw: st.DrawFn,
    end: str = "time",
    mode: AutoresetMode | None = None,
    plan: BodyPlan = AQUAFISH,
) -> Scene:
    """Return what robots swim; ``end`` is how their episodes end."""
    fins = len(plan.fins)
    tasks = [task for task in ENDS[end] if plan == AQUAFISH or task is not NEAR]
    task = draw(st.sampled_from(tasks))
    near = task is NEAR
    hold = 20 if near or end == "divergence" else draw(st.sampled_from([5, 20, 50]))
    limit = 30 if near else draw(st.integers(2, 6))
    if draw(st.booleans()):  # by the task, or by Gymnasium's limit
        task, more = replace(task, seconds=limit * hold / 100), {}
    else:
        task, more = replace(task, seconds=max(task.seconds, 3.0)), {"max_episode_steps": limit}
    own = type(task).current is not SwimForward.current
    current = st.just((0.0, 0.0, 0.0)) if own else st.sampled_from([(0.0,) * 3, (0.1, -0.2, 0.05)])
    options = {
        "task": task,
        "fin_angles": draw(st.sampled_from(["random", (0.1, -0.2, 0.3, 0.4)[:fins]])),
        "observe_fins": draw(st.sampled_from([False, True, "reckoned"])),
        "current": draw(current),
        "reactive": end != "divergence" and draw(st.booleans()),
        "frame_skip": hold,
        "plan": plan,
        **more,
    }
    if end == "divergence":
        options |= {"morphology": THIN, "current": ROUGH, "fin_angles": "random"}
    whole = end == "divergence"
    broken = ["none" if whole else draw(damages(hold / 100, limit, plan)) for _ in range(COUNT)]
    seed = BEFORE_DIVERGING_SEED if whole else draw(st.integers(0, 1000))
    steers = "to the buoys" if near else "steadily" if whole else "at random"
    mode = mode or draw(st.sampled_from(MODES))
    return Scene(options, tuple(broken), mode, limit, seed, steers, fins)


@st.composite
def damages_of_channels(draw: st.DrawFn, dt: float, limit: int, plan: BodyPlan) -> tuple[str, str]:
    """Return damage of one robot, and the same in the names of channels of any environment."""
    turns = [fin.name for fin in plan.fins if fin.turns]
    names_of_channels = {
        **{name: f"action_{i}" for i, name in enumerate(plan.names)},
        "up_x": "observation_0", "north_y": "observation_4", "gyro_z": "observation_8",
    }  # fmt: skip
    found = []
    for _ in range(draw(st.integers(0, 3))):
        part = draw(st.sampled_from(list(names_of_channels)))
        lateness = f"{draw(late) * dt:.4g}"
        words = [f"delay={lateness}", f"hold={lateness}"]
        if "obs" in names_of_channels[part]:
            words += ["scale=0.5", "stuck", "dropped", "bias=0.4"]
        else:
            words += ["dead"]
        if "gyro" in part:
            words += ["bias=40"]  # beyond its range
        if part in turns:  # the servo of one that sweeps stops at another action than 0
            words += ["scale=0.5", "weak=0.5", "reversed"]
        onset = draw(st.sampled_from([0.0, 1.0, 1.6, limit - 1.0])) * dt
        until = draw(st.sampled_from(["", f"+{2 * dt:.4g}"]))
        found.append((part, draw(st.sampled_from(words)), f"@{onset:.4g}{until}"))
    # A servo whose motor is dead from the start stands at any angle, and a seized one at its own.
    names = {"dead": "seized"}
    built_in = "; ".join(f"{part}:{names.get(word, word)}{time}" for part, word, time in found)
    channels = "; ".join(f"{names_of_channels[part]}:{word}{time}" for part, word, time in found)
    return built_in or "none", channels or "none"
