"""The residual is tiny and the parameters are wrong: which were measured, and what would tell.

    python examples/answers/unmeasured.py --out out/unmeasured.png

A double pendulum with motors and encoders, in MuJoCo (extra mujoco). mujoco.sysid is run beside it
where ``pip install "mujoco[sysid]"`` has installed what that needs.
"""

from __future__ import annotations

import argparse
import copy
from contextlib import redirect_stdout
from importlib import import_module
from importlib.util import find_spec
from io import StringIO
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
from mujoco.rollout import Rollout
from numpy.typing import NDArray

from eea import FitConfig, Number, Robot, Trial

# It is without functions where what it needs is not installed.
SYSID: Any = import_module("mujoco.sysid") if find_spec("mujoco.sysid") else None
LENGTH = 0.3  # m, from shoulder to elbow
LINK = """
<inertial pos="0 0 {centre}" mass="{mass}" diaginertia="{inertia} {inertia} 0.005"/>
<joint name="joint {name}" axis="0 1 0" damping="{damping}"/>"""
SENSORS = (
    '<jointpos name="angle {0}" joint="joint {0}"/><jointvel name="rate {0}" joint="joint {0}"/>'
)
#: Of each link, as MuJoCo takes it: kg, m from its joint, kg m^2 about its centre, N m s/rad.
TRUTH = {
    1: {"mass": 1.2, "centre": -0.12, "inertia": 0.02, "damping": 0.05},
    2: {"mass": 0.8, "centre": -0.1, "inertia": 0.01, "damping": 0.03},
}
STEPS = 200  # in a trial
STEP_SECONDS = 0.01
SYSID_STARTS = 6
NOISE = {"angle": 0.002, "rate": 0.02, "force": 0.1}  # rad, rad/s, N


def arm(links: int, on_plate: bool) -> Any:
    """Return the specification of the arm, whole or without link 2, on a force plate or not."""
    inner = ""
    for link in range(links, 0, -1):
        at = -LENGTH if link == 2 else 0.0
        body = LINK.format(name=link, **TRUTH[link]) + inner
        inner = f'<body name="link {link}" pos="0 0 {at}">{body}</body>'
    each = range(1, links + 1)
    plate = '<force name="force" site="base"/>' if on_plate else ""
    return mujoco.MjSpec.from_string(f"""
<mujoco>
  <compiler inertiafromgeom="false"/>
  <option timestep="{STEP_SECONDS}" integrator="implicitfast"><flag contact="disable"/></option>
  <worldbody><body><site name="base"/>{inner}</body></worldbody>
  <actuator>{"".join(f'<motor name="motor {k}" joint="joint {k}"/>' for k in each)}</actuator>
  <sensor>{"".join(map(SENSORS.format, each))}{plate}</sensor>
</mujoco>""")


def standard(links: Any) -> dict[str, float]:
    """Return the numbers of the robot of links as MuJoCo has them."""
    found: dict[str, float] = {}
    for link, own in links.items():
        moment = -own["mass"] * own["centre"]
        about_joint = own["inertia"] + own["mass"] * own["centre"] ** 2
        found |= {f"mass {link}": own["mass"], f"moment {link}": moment}
        found |= {f"inertia {link}": about_joint, f"damping {link}": own["damping"]}
    return found


TRUE = standard(TRUTH)
MODELS = {links: [arm(links, True).compile()] for links in (1, 2)}
POOL = Rollout(nthread=2)
mujoco.set_mju_user_warning(lambda _: None)  # of arms that fly apart in the search


def swing(values: Any, torques: NDArray[Any]) -> NDArray[Any]:
    """Return angle and rate of two joints and force (B, T, 6) under torques (B, T, links), N m.

    ``moment`` is a link's mass times its centre's distance from its joint, ``inertia`` about that.
    """
    links = torques.shape[2]
    impossible = ~_possible(values, links)
    values = {name: np.where(impossible, TRUE[name], value) for name, value in values.items()}
    models = MODELS[links]
    while len(models) < len(torques):
        models.append(copy.copy(models[0]))
    for link in range(1, links + 1):
        mass, moment, inertia = (values[f"{name} {link}"] for name in ("mass", "moment", "inertia"))
        about_centre = inertia - moment**2 / mass
        for k in range(len(torques)):
            models[k].body_mass[1 + link] = mass[k]
            models[k].body_ipos[1 + link, 2] = -moment[k] / mass[k]
            models[k].body_inertia[1 + link, :2] = about_centre[k]
            models[k].dof_damping[link - 1] = values[f"damping {link}"][k]
    data = [mujoco.MjData(models[0]) for _ in range(2)]
    start = np.zeros((len(torques), 1 + 2 * links))
    sensors = POOL.rollout(models[: len(torques)], data, start, torques)[1]
    seen = np.zeros((*torques.shape[:2], 6))
    seen[:, :, : 2 * links] = sensors[:, :, : 2 * links]
    seen[:, :, 4:] = sensors[:, :, [-3, -1]]
    seen[impossible] = np.nan
    return seen


def _possible(values: Any, links: int) -> NDArray[np.bool_]:
    """Return which arms have a positive kinetic energy in every pose, as any must."""
    if links == 1:
        return np.asarray(values["inertia 1"] > 0.0)
    upper = values["inertia 1"] + LENGTH**2 * values["mass 2"]
    return np.asarray(upper * values["inertia 2"] > (LENGTH * values["moment 2"]) ** 2)


UNITS = {"mass": "kg", "moment": "kg m", "inertia": "kg m^2", "damping": "N m s"}
RANGES = {"mass": (0.2, 3.0), "moment": (0.0, 1.0), "inertia": (0.001, 0.3), "damping": (0.0, 0.3)}
ROBOT = Robot(
    simulate=swing,
    numbers={
        f"{name} {link}": Number(*RANGES[name], unit=UNITS[name])
        for link in TRUTH
        for name in RANGES
    },
    channels={"angle 1": "rad", "rate 1": "rad/s", "angle 2": "rad", "rate 2": "rad/s"}
    | {"force x": "N", "force z": "N"},
)
KNOWN_NOISE = {name: NOISE[name.split()[0]] for name in ROBOT.channels}
EFFORT = FitConfig(bodies=32, poses=1, descents=4, polished=1, restarts=0)


def torques(gain: float = 1.0) -> NDArray[Any]:
    """Return torques (T, 2) of a swing, N m."""
    time = STEP_SECONDS * np.arange(STEPS)
    shoulder = 2.0 * np.sin(3.0 * time) + 1.5 * np.sin(7.1 * time)
    return gain * np.stack([shoulder, 0.8 * np.sin(5.0 * time + 1.0)], axis=-1)


def perform(pushes: NDArray[Any], on_plate: bool, rng: np.random.Generator) -> Trial:
    """Return what the true arm shows under torques (T, links); what is not read is missing."""
    values = {name: np.array([value]) for name, value in TRUE.items()}
    signal = swing(values, pushes[None])[0]
    signal += rng.normal(0.0, list(KNOWN_NOISE.values()), signal.shape)
    signal[:, 2 * pushes.shape[1] : 4] = np.nan
    if not on_plate:
        signal[:, 4:] = np.nan
    return Trial(signal, pushes)


def misfit(values: dict[str, float], trials: list[Trial]) -> float:
    """Return the root mean square of what numbers leave of trials, in multiples of the noise."""
    left = []
    for trial in trials:
        arrays = {name: np.array([value]) for name, value in values.items()}
        apart = swing(arrays, np.asarray(trial.inputs)[None])[0] - trial.signal
        left.append((apart / list(KNOWN_NOISE.values())).ravel())
    return float(np.sqrt(np.nanmean(np.concatenate(left) ** 2)))


#: Of what mujoco.sysid seeks, in MuJoCo's own numbers.
SYSID_RANGES = {"mass": (0.2, 3.0), "centre": (-0.3, -0.01), "inertia": (0.003, 0.1)}
SYSID_RANGES |= {"damping": (0.0, 0.3)}


def _modifier(link: int, name: str) -> Any:
    """Return what writes a parameter of mujoco.sysid into a specification."""

    def write(spec: Any, parameter: Any) -> None:
        body = spec.body(f"link {link}")
        value = float(parameter.value[0])
        if body is None:  # it is taken off
            return
        if name == "mass":
            body.mass = value
        elif name == "centre":
            body.ipos = [0.0, 0.0, value]
        elif name == "inertia":
            body.inertia = [value, value, 0.005]
        else:
            body.joints[0].damping[0] = value

    return write


def _sequence(trial: Trial, rng: np.random.Generator) -> Any:
    """Return a trial as mujoco.sysid takes it: all sensors of a model, so the force y as well."""
    pushes = np.asarray(trial.inputs)
    signal = np.asarray(trial.signal)
    steps, links = pushes.shape
    seen = signal[:, : 2 * links]
    on_plate = bool(np.isfinite(signal[:, 4]).all())
    if on_plate:
        across = rng.normal(0.0, NOISE["force"], steps)
        seen = np.column_stack([seen, signal[:, 4], across, signal[:, 5]])
    spec = arm(links, on_plate)
    model = spec.compile()
    time = STEP_SECONDS * np.arange(steps + 1)
    start = SYSID.create_initial_state(model, np.zeros(links), np.zeros(links), np.zeros(0))
    control = SYSID.TimeSeries(time, np.concatenate([pushes, pushes[-1:]]))
    sensors = SYSID.TimeSeries.from_names(time[1:], seen, model)
    return SYSID.ModelSequences(f"{links} links", spec, "swing", start, control, sensors)


def by_sysid(trials: list[Trial], starts: list[dict[str, float] | None]) -> list[dict[str, float]]:
    """Return what mujoco.sysid finds from starts, as numbers of the robot; None is a random one."""
    rng = np.random.default_rng(1)
    residual = SYSID.build_residual_fn(models_sequences=[_sequence(one, rng) for one in trials])
    found = []
    for start in starts:
        sought = SYSID.ParameterDict()
        for link in TRUTH:
            for name, ends in SYSID_RANGES.items():
                write = _modifier(link, name)
                sought.add(SYSID.Parameter(f"{name} {link}", np.mean(ends), *ends, modifier=write))
        sought.randomize(rng)
        if start is not None:
            sought.update_from_vector(np.array(list(_as_mujoco(start).values())))
        with redirect_stdout(StringIO()):  # it prints each iteration
            best, _ = SYSID.optimize(sought, residual, verbose=False, max_iters=50)
        links = {
            link: {name: float(best[f"{name} {link}"].value[0]) for name in SYSID_RANGES}
            for link in TRUTH
        }
        found.append(standard(links))
    return found


def _as_mujoco(values: dict[str, float]) -> dict[str, float]:
    """Return the numbers that MuJoCo takes of numbers of the robot, in the order of the ranges."""
    found: dict[str, float] = {}
    for link in TRUTH:
        mass, moment, inertia, damping = (values[f"{name} {link}"] for name in RANGES)
        own = {"mass": mass, "centre": -moment / mass, "inertia": inertia - moment**2 / mass}
        found |= {f"{name} {link}": x for name, x in {**own, "damping": damping}.items()}
    return found


def show_sysid(fits: list[dict[str, float]], trials: list[Trial]) -> None:
    """Print how well fits of mujoco.sysid explain trials, and how far they differ."""
    left = max(misfit(one, trials) for one in fits)
    print(f"mujoco.sysid: {len(fits)} fits leave at most {left:.3f} times the noise")
    for name in ("mass 1", "mass 2", "moment 1"):
        each = [one[name] for one in fits]
        print(f"mujoco.sysid: {name} {min(each):.3g} to {max(each):.3g}, true {TRUE[name]:.3g}")
    sums = [one["moment 1"] + LENGTH * one["mass 2"] for one in fits]
    print(f"mujoco.sysid: moment 1 + 0.3 mass 2 {min(sums):.4f} to {max(sums):.4f}")


def main(out: Path | None = None) -> None:
    """Print what a swing determines and what would determine the rest, and draw it."""
    rng = np.random.default_rng(0)
    first = perform(torques(), False, rng)
    candidates = {
        "swing harder": perform(torques(1.5), False, rng),
        "swing on a force plate": perform(torques(), True, rng),
        "swing without link 2": perform(torques()[:, :1], False, rng),
        "swing without link 2 on a force plate": perform(torques()[:, :1], True, rng),
    }
    print("one swing of 2 s, with encoders")
    fits: list[dict[str, float]] = []
    if hasattr(SYSID, "optimize"):
        fits = by_sysid([first], [None] * SYSID_STARTS)
        fits = [one for one in fits if misfit(one, [first]) < 1.1]
        show_sysid(fits, [first])
    found = ROBOT.infer([first], noise=KNOWN_NOISE, config=EFFORT)
    print("\n".join([found.verdict, *found.identified().findings]))

    print("what another trial would tell")
    prospects = found.prospects(candidates)
    for name, prospect in prospects.items():
        open_numbers = " and ".join(prospect.identified.untold) or "nothing"
        print(f"{name}: {prospect.bits:.1f} bits, and {open_numbers} left open")

    best = next(iter(prospects))
    print(f"with that trial: {best}")
    trials = [first, candidates[best]]
    if fits:
        show_sysid(by_sysid(trials, [fits[0]]), trials)
    known = ROBOT.infer(trials, noise=KNOWN_NOISE, config=EFFORT)
    print("\n".join([known.verdict, *known.identified().findings]))
    print("true: " + "; ".join(f"{name} {value:.4g}" for name, value in TRUE.items()))
    if out is not None:
        draw(out, fits, found, known, prospects)


def draw(out: Path, fits: list[dict[str, float]], found: Any, known: Any, prospects: Any) -> None:
    """Draw what fits alike before and after the trial, and what each trial is worth."""
    import matplotlib.pyplot as plt

    figure, (left, right) = plt.subplots(1, 2, figsize=(10.5, 4.0), width_ratios=(1.0, 1.1))
    names = list(ROBOT.sought)
    columns = [names.index("mass 2"), names.index("moment 1")]
    x, y = found.sample(400, np.random.default_rng(0))[:, columns].T
    left.plot(x, y, ".", color="0.72", markersize=4, label="posterior of one swing")
    if fits:
        x, y = ([one[name] for one in fits] for name in ("mass 2", "moment 1"))
        left.plot(x, y, "o", color="tab:orange", label="fits of mujoco.sysid")
    x, y = known.sample(100, np.random.default_rng(0))[:, columns].T
    left.plot(x, y, "s", color="tab:blue", markersize=7, label="with the one trial")
    left.plot(TRUE["mass 2"], TRUE["moment 1"], "k+", markersize=16, label="true")
    left.set(xlabel="mass 2 (kg)", ylabel="moment 1 (kg m)", title="All of these fit the swing")
    left.legend(frameon=False)
    rows = list(prospects.items())[::-1]
    right.barh(range(len(rows)), [one.bits for _, one in rows], color="tab:blue", height=0.45)
    for row, (name, prospect) in enumerate(rows):
        leaves = " and ".join(prospect.identified.untold)
        worth = f"leaves {leaves} open" if leaves else "tells all"
        right.text(0.3, row + 0.3, f"{name}: {worth}")
    right.set(
        xlabel="expected information (bits)", yticks=[], title="What another trial would tell"
    )
    right.set_ylim(-0.5, len(rows) - 0.3)
    for axes in (left, right):
        axes.spines[["top", "right"]].set_visible(False)
    figure.tight_layout()
    out.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(out, dpi=110)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--out", type=Path, default=Path("out/unmeasured.png"))
    main(parser.parse_args().out)
