"""What the fish's law is compared with: three predictors of a swim from the last beat's mean rates.

They see a run at 5 Hz, its rates averaged over the samples of the last beat of 0.8 s.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.optimize import least_squares

from experiments.real.michigan import STRIDE, Floats, Run
from experiments.real.planar_fish import FRAME

STEP = STRIDE * FRAME  # s
AVERAGED = 5  # samples
RIDGE = 1e-6  # of the Koopman regression
SUBSTEPS = 4
STEADY = "same speed and turn"
KOOPMAN = "Koopman, 46 functions"
AVERAGED_BEAT = "nine numbers, averaged over a beat"
RIVALS = (STEADY, KOOPMAN, AVERAGED_BEAT)


def series(run: Run) -> Floats:
    """Return pose and mean rates (n, 6) at 5 Hz."""
    rows = STRIDE * np.arange(run.samples)
    rates = run.rates[rows]
    mean = [rates[max(0, i - AVERAGED + 1) : i + 1].mean(axis=0) for i in range(len(rates))]
    return np.hstack([run.pose[rows], mean])


def rival_paths(
    known: Sequence[Run], runs: Sequence[Run], starts: Sequence[int], samples: int
) -> dict[str, Floats]:
    """Return what each rival, fitted to known runs, predicts (B, samples, 3).

    ``starts`` (B,) are samples of ``runs`` (B,). The first pose is 0.2 s after the start.
    """
    state = np.array([series(run)[start] for run, start in zip(runs, starts, strict=True)])
    tail = np.array([run.tail for run in runs])
    numbers = _fit_averaged(known)
    return {
        STEADY: _steady(state, samples),
        KOOPMAN: _predict_koopman(_fit_koopman(known), state, tail, samples),
        AVERAGED_BEAT: _averaged(numbers, state, tail, samples),
    }


def _steady(state: Floats, samples: int) -> Floats:
    """Keep the speed ahead and the yaw rate."""
    h = STEP / SUBSTEPS
    x, y, heading, speed, _, turn = state.T
    t = h * np.arange(1, SUBSTEPS * samples + 1)[:, None]
    course = heading + turn * t
    path = [
        x + h * np.cumsum(speed * np.cos(course), 0),
        y + h * np.cumsum(speed * np.sin(course), 0),
    ]
    return np.stack([*path, course], axis=-1)[SUBSTEPS - 1 :: SUBSTEPS].swapaxes(0, 1)


def _lifted(state: Floats, tail: Floats) -> Floats:
    """Return 46 functions (n, 46) of states (n, 6) and commands (n, 2).

    After those of Mamakoukas et al.: the state, products and cubes of the rates, the rates and
    their products turned by the heading, and the command.
    """
    rates = state[:, 3:]
    u, v, r = rates.T
    heading = state[:, 2:3]
    products = np.column_stack([u * u, u * v, u * r, v * v, v * r, r * r])
    both = np.hstack([rates, products])
    cubes = [u**3, u * u * v, u * u * r, u * v * v, u * v * r, u * r * r]
    cubes += [v**3, v * v * r, v * r * r, r**3, r * np.abs(r)]
    amplitude, bias = tail.T
    pushes = [amplitude**2 * np.sin(bias), amplitude**2 * np.cos(bias), amplitude, bias]
    turned = [both * np.cos(heading), both * np.sin(heading)]
    rest = np.column_stack([*cubes, *pushes, np.ones(len(state))])
    return np.hstack([state, products, *turned, rest])


def _fit_koopman(known: Sequence[Run]) -> Floats:
    """Return the matrix (46, 46) that takes the functions one sample on: ridge regression."""
    lifts = [_lifted(series(run), np.tile(run.tail, (run.samples, 1))) for run in known]
    now = np.concatenate([one[:-1] for one in lifts])
    after = np.concatenate([one[1:] for one in lifts])
    scale = now.std(axis=0) + 1e-6
    now = now / scale
    normal = now.T @ now + RIDGE * len(now) * np.eye(len(scale))
    found = np.linalg.solve(normal, now.T @ (after / scale)).T
    return np.asarray(found * scale[:, None] / scale)


def _predict_koopman(matrix: Floats, state: Floats, tail: Floats, samples: int) -> Floats:
    lift = _lifted(state, tail)
    path = []
    for _ in range(samples):
        lift = lift @ matrix.T
        path.append(lift[:, :3])
    return np.stack(path, axis=1)


def _averaged(numbers: Floats, state: Floats, tail: Floats, samples: int) -> Floats:
    """Predict by thrust ~ amplitude^2, quadratic drag, and turning by thrust and by speed."""
    thrust, less, drag, slowed, push, steer, damping, linear, trim = numbers
    h = STEP / SUBSTEPS
    x, y, heading, speed, _, turn = state.T
    square = tail[:, 0] ** 2
    aside = np.sin(tail[:, 1])
    path = []
    for i in range(SUBSTEPS * samples):
        ahead = thrust * square * (1 - less * aside**2)
        speed = speed + h * (ahead - drag * speed * np.abs(speed) - 0.1 * slowed * turn**2)
        torque = -push * square * aside - steer * speed * aside + trim * speed
        turn = turn + h * (torque - damping * turn * np.abs(turn) - linear * turn)
        heading = heading + h * turn
        x = x + h * speed * np.cos(heading)
        y = y + h * speed * np.sin(heading)
        if i % SUBSTEPS == SUBSTEPS - 1:
            path.append(np.stack([x, y, heading], axis=-1))
    return np.stack(path, axis=1)


def _fit_averaged(known: Sequence[Run]) -> Floats:
    """Return the nine numbers, by robust least squares of poses 1 to 5 s after starts 3 s apart."""
    starts = [(run, series(run), j) for run in known for j in list(run.starts)[::3]]
    state = np.array([rows[j] for _, rows, j in starts])
    tail = np.array([run.tail for run, _, _ in starts])
    samples = 25
    seen = np.full((len(starts), samples, 3), np.nan)
    for row, (_, rows, j) in zip(seen, starts, strict=True):
        after = rows[j + 1 : j + 1 + samples, :3]
        row[: len(after)] = after

    def left(numbers: Floats) -> Floats:
        with np.errstate(over="ignore", invalid="ignore"):
            apart = (_averaged(numbers, state, tail, samples) - seen)[:, 4::5] * (1.0, 1.0, 0.1)
        there = np.isfinite(seen[:, 4::5])
        finite = np.nan_to_num(apart[there], nan=10.0, posinf=10.0, neginf=-10.0)
        # A path that diverges is cut before its square overflows.
        return np.asarray(np.clip(finite, -1e6, 1e6))

    first = [2.0, 0.5, 3.0, 0.1, 3.0, 3.0, 3.0, 2.0, 0.0]
    found = least_squares(left, first, loss="soft_l1", f_scale=0.05, max_nfev=25)
    return np.asarray(found.x)
