"""How well the drag law's few points stand for the whole surface.

The reference integrates the law by 64 x 64 Gauss points over each of a fin's three plates, and
finely along the capsule and over the fin mounts. Beside the law's own rule stand others of its
kind: points in the plane of length and width, at which the law of all three plates acts at once.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from aquafish_gym.physics.hydrodynamics import (
    AXIAL_DRAG,
    CROSS_FLOW_DRAG,
    DENSITY,
    NORMAL_DRAG,
    SKIN_FRICTION,
    body_drag,
)
from aquafish_gym.physics.layout import layout
from aquafish_gym.physics.robot import MOUNT_LENGTH, hull_numbers
from aquafish_gym.plans import AQUAFISH, BodyPlan, FinPlan, Hull
from instruments.verification.harness import drag
from instruments.verification.momentum import fin_axes, hinge_motion
from instruments.verification.rk4 import rotation_matrix
from instruments.verification.trials import Trials, lane_batch, random_trials

Array = NDArray[np.float64]
Rule = tuple[Array, Array]  # nodes and weights on [-1/2, 1/2]; the weights add up to 1

FINE = 64  # points along each side of the reference


def gauss_rule(points: int) -> Rule:
    """Return the Gauss-Legendre rule."""
    nodes, weights = np.polynomial.legendre.leggauss(points)
    return nodes / 2, weights / 2


def midpoint_rule(points: int) -> Rule:
    """Return the rule of equal stretches, each taken at its middle."""
    return (np.arange(points) + 0.5) / points - 0.5, np.full(points, 1 / points)


def plate_wrench(
    coefficients: Array,
    middle: Array,
    sides: tuple[Array, Array],
    rules: tuple[Rule, Rule],
    motion: Array,
    leading: tuple[int, float] | None = None,
) -> Array:
    """Integrate the law over one plate of each of B bodies.

    Parameters
    ----------
    coefficients
        (3, B) force per |V| V along each axis, of the whole plate.
    middle
        (3, B) of the plate.
    sides
        (3, B) each: the plate reaches half of them to both sides of its middle.
    rules
        Where to take points along each side.
    motion
        (6, B) velocity of the origin and angular velocity.
    leading
        An axis and a sign: only points that move that way count.

    Returns
    -------
    ndarray
        (6, B) force, and torque about the origin.
    """
    total = np.zeros((6, middle.shape[1]))
    (first, first_weights), (second, second_weights) = rules
    for u, weight in zip(first, first_weights, strict=True):
        for v, share in zip(second, second_weights, strict=True):
            point = middle + u * sides[0] + v * sides[1]
            moving = motion[:3] + _cross(motion[3:], point)
            force = -(weight * share) * coefficients * np.sqrt((moving**2).sum(axis=0)) * moving
            if leading is not None:
                force = force * (moving[leading[0]] * leading[1] > 0)
            total[:3] += force
            total[3:] += _cross(point, force)
    return total


def _cross(a: Array, b: Array) -> Array:
    return np.stack(
        [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
    )


def _faces(size: Array) -> Array:
    """Return the areas (3, B) of the plates whose normals are the three axes."""
    return np.stack([size[1] * size[2], size[0] * size[2], size[0] * size[1]])


def _axis(size: Array, axis: int) -> Array:
    side = np.zeros_like(size)
    side[axis] = size[axis]
    return side


def _middle(size: Array) -> Array:
    """Return the fins' middles in their frames: half a length behind the hinge."""
    return -0.5 * _axis(size, 1)


def fin_reference(size: Array, motion: Array, points: int = FINE) -> Array:
    """Return the wrench (6, B) on three whole plates.

    Parameters
    ----------
    size
        (3, B) width, length, thickness.
    motion
        (6, B) the hinge's velocity and the fin's angular velocity, in the fin frame.
    points
        Along each side of each plate.
    """
    rule = gauss_rule(points)
    total = np.zeros((6, size.shape[1]))
    for normal, area in enumerate(_faces(size)):
        coefficients = np.tile(DENSITY * SKIN_FRICTION * area, (3, 1))
        coefficients[normal] = 0.5 * DENSITY * NORMAL_DRAG * area
        one, other = (_axis(size, axis) for axis in range(3) if axis != normal)
        total += plate_wrench(coefficients, _middle(size), (one, other), (rule, rule), motion)
    return total


def fin_as_box(size: Array, motion: Array, points: int = FINE) -> Array:
    """Return the wrench (6, B) on a box of six faces, of which only those that lead drag.

    Another model, not a better rule: a face rubs always, and has the plate's normal drag while
    it moves outwards. How far it is from the three plates says what the choice between them is
    worth.
    """
    rule = gauss_rule(points)
    total = np.zeros((6, size.shape[1]))
    for normal, area in enumerate(_faces(size)):
        rub = np.tile(0.5 * DENSITY * SKIN_FRICTION * area, (3, 1))
        drag = np.zeros_like(rub)
        drag[normal] = 0.5 * DENSITY * NORMAL_DRAG * area
        rub[normal] = 0.0
        one, other = (_axis(size, axis) for axis in range(3) if axis != normal)
        for side in (-0.5, 0.5):
            middle = _middle(size) + side * _axis(size, normal)
            rules = (rule, rule)
            total += plate_wrench(rub, middle, (one, other), rules, motion)
            total += plate_wrench(drag, middle, (one, other), rules, motion, (normal, side))
    return total


def fin_by_rule(size: Array, motion: Array, along: Rule, across: Rule) -> Array:
    """Return the wrench (6, B) by points along the length and across the width.

    At each of them the law of all three plates acts at once, as in ``hydrodynamics.fin_drag``.
    """
    faces = _faces(size)
    edges = faces.sum(axis=0) - faces
    coefficients = 0.5 * DENSITY * (NORMAL_DRAG * faces + 2 * SKIN_FRICTION * edges)
    sides = (_axis(size, 1), _axis(size, 0))
    return plate_wrench(coefficients, _middle(size), sides, (along, across), motion)


def capsule_wrench(motion: Array, y: Array, widths: Array) -> Array:
    """Return the cross-flow wrench (6, B) by strips at ``y`` that are ``widths`` wide in all."""
    total = np.zeros_like(motion)
    for at, width in zip(y, widths, strict=True):
        vx, vz = motion[0] - motion[5] * at, motion[2] + motion[3] * at
        k = -0.5 * DENSITY * CROSS_FLOW_DRAG * width * np.sqrt(vx**2 + vz**2)
        total[0] += k * vx
        total[2] += k * vz
        total[3] += at * k * vz
        total[5] -= at * k * vx
    return total


def _diameters(hull: Hull, y: Array) -> Array:
    beyond = np.maximum(abs(y) - (hull.length / 2 - hull.radius), 0.0)
    diameters: Array = 2 * np.sqrt(np.maximum(hull.radius**2 - beyond**2, 0.0))
    return diameters


def even_strips(hull: Hull, count: int) -> tuple[Array, Array]:
    """Return places and areas of strips of equal length."""
    nodes, weights = midpoint_rule(count)
    y = hull.length * nodes
    return y, hull.length * weights * _diameters(hull, y)


def fine_strips(hull: Hull, points: int = 4 * FINE) -> tuple[Array, Array]:
    """Return places and areas of Gauss strips along the cylinder and each cap."""
    radius, cylinder = hull.radius, hull.length - 2 * hull.radius
    nodes, weights = gauss_rule(points)
    # Near a pole the diameter is a square root of the distance: as a power of the node it is
    # smooth.
    cap = radius * (1 - (nodes + 0.5) ** 2)
    cap_weights = radius * 2 * (nodes + 0.5) * weights
    y = np.concatenate([-cylinder / 2 - cap, cylinder * nodes, cylinder / 2 + cap])
    return y, np.concatenate([cap_weights, cylinder * weights, cap_weights]) * _diameters(hull, y)


def mount_plates(plan: BodyPlan) -> Iterator[tuple[Array, Array, float, float]]:
    """Yield each plate between hull and hinge: its middle, axes, width and length.

    The axes are columns: away from the hull's axis, along it, and across both.
    """
    along = np.array([0.0, 1.0, 0.0])
    for fin in plan.fins:
        hinge = np.array(fin.hinge)
        aside = hinge * [1.0, 0.0, 1.0]
        away = float(np.linalg.norm(aside))
        width = away - plan.hull.radius
        if width > 0:
            outward = aside / away
            middle = hinge - width / 2 * outward
            axes = np.stack([outward, along, np.cross(outward, along)], axis=1)
            yield middle, axes, width, MOUNT_LENGTH


def body_by_strips(
    plan: BodyPlan, motion: Array, strips: tuple[Array, Array], mount_points: int
) -> Array:
    """Return the wrench (6, B) on capsule and mounts, with these strips and mount points."""
    hull, ones = plan.hull, np.ones(motion.shape[1])
    total = capsule_wrench(motion, *strips)
    total[1] -= 0.5 * DENSITY * AXIAL_DRAG * np.pi * hull.radius**2 * abs(motion[1]) * motion[1]
    roll = hull_numbers(hull).roll_area
    total[4] -= 0.5 * DENSITY * SKIN_FRICTION * roll * abs(motion[4]) * motion[4]
    rule = gauss_rule(mount_points)
    for middle, axes, width, length in mount_plates(plan):
        of_area = np.outer([SKIN_FRICTION, SKIN_FRICTION, NORMAL_DRAG / 2], ones)
        wrench = plate_wrench(
            DENSITY * width * length * of_area,
            np.outer(axes.T @ middle, ones),
            (np.outer([width, 0, 0], ones), np.outer([0, length, 0], ones)),
            (rule, rule),
            _turned(axes.T, motion),
        )
        total += _turned(axes, wrench)
    return total


def _turned(matrix: Array, pairs: Array) -> Array:
    """Return pairs of vectors (6, B) turned by a matrix."""
    return np.concatenate([matrix @ pairs[:3], matrix @ pairs[3:]])


def body_reference(motion: Array, points: int = FINE, plan: BodyPlan = AQUAFISH) -> Array:
    """Return the wrench (6, B) on capsule and mounts; ``motion`` (6, B) is in body axes."""
    return body_by_strips(plan, motion, fine_strips(plan.hull, 4 * points), points)


def body_by_law(motion: Array, plan: BodyPlan = AQUAFISH) -> Array:
    """Return what ``hydrodynamics.body_drag`` says (6, B)."""
    columns = motion.T.tolist()
    return np.array(
        [np.concatenate(body_drag(plan, tuple(m[:3]), tuple(m[3:]))) for m in columns]
    ).T


OTHER_RULES: tuple[tuple[str, Callable[[int], Rule], int, int], ...] = (
    ("midpoint", midpoint_rule, 1, 1),
    ("midpoint", midpoint_rule, 2, 1),
    ("midpoint", midpoint_rule, 2, 2),
    ("midpoint", midpoint_rule, 3, 2),
    ("midpoint", midpoint_rule, 4, 2),
    ("midpoint", midpoint_rule, 8, 4),
    ("Gauss", gauss_rule, 2, 1),
    ("Gauss", gauss_rule, 2, 2),
    ("Gauss", gauss_rule, 3, 1),
    ("Gauss", gauss_rule, 3, 2),
    ("Gauss", gauss_rule, 4, 2),
    ("Gauss", gauss_rule, 4, 3),
)
SIX_FACES = "six faces, finely"
STRIPS = (2, 4, 8, 16, 32)


@dataclass(frozen=True)
class Met:
    """Motions that robots meet while they swim.

    ``fins`` are sizes (3, B) and motions (6, B) of each fin in its frame, ``bodies`` is the motion
    (6, B) of the hull in body axes.
    """

    fins: list[tuple[Array, Array]]
    bodies: Array


def motions_met(trials: Trials, times: tuple[int, ...] = (50, 130, 210)) -> Met:
    """Let trials swim in still water and return their motions after these steps of 0.01 s."""
    plan = trials.plan
    lanes = lane_batch(trials.morphologies, trials.fin_angles, dtype=np.float64, plan=plan)
    found: list[list[Array]] = [[] for _ in plan.fins]
    bodies = []
    done = 0
    for steps in times:
        lanes.advance(trials.commands, steps - done)
        done = steps
        now = lanes.state()
        turns = np.array([rotation_matrix(q) for q in np.transpose(now.orientation)])
        velocity = np.einsum("bji,jb->ib", turns, np.array(now.velocity))
        body = np.concatenate([velocity, now.spin])
        phases = layout(plan).angles(lanes.states).T
        angles, _, _ = hinge_motion(plan, phases, np.zeros_like(phases))
        for i, fin in enumerate(plan.fins):
            found[i].append(_in_fin_frame(fin, body, angles[:, i], np.asarray(now.rates[i])))
        bodies.append(body)
    sizes = np.tile(trials.morphologies.T, (1, len(times)))
    fins = [
        (sizes[columns], np.concatenate(motions, axis=1))
        for columns, motions in zip(plan.columns, found, strict=True)
    ]
    return Met(fins, np.concatenate(bodies, axis=1))


def _in_fin_frame(fin: FinPlan, body: Array, angles: Array, rates: Array) -> Array:
    """Return the motion (6, B) of a fin's hinge and of the fin, in the fin's own axes."""
    hinge = np.outer(fin.hinge, np.ones(body.shape[1]))
    velocity = body[:3] + _cross(body[3:], hinge)
    spin = body[3:] + np.outer(fin.axis, rates)
    axes = np.array([fin_axes(fin, angle) for angle in angles])
    return np.concatenate([np.einsum("bji,jb->ib", axes, v) for v in (velocity, spin)])


def random_motion(rng: np.random.Generator, count: int) -> Array:
    """Return motions (6, count) of a fin that are wilder than what is met while swimming."""
    motion = np.concatenate([0.5 * rng.normal(size=(3, count)), 1.5 * rng.normal(size=(3, count))])
    motion[3] += rng.uniform(-np.pi, np.pi, count)
    return motion


def relative_errors(found: Array, truth: Array) -> tuple[float, float]:
    """Return the rms error of force and torque, each relative to its own rms."""
    errors = ((found - truth) ** 2).reshape(2, -1).mean(axis=1)
    force, torque = np.sqrt(errors / (truth**2).reshape(2, -1).mean(axis=1))
    return float(force), float(torque)


def _kinds(plan: BodyPlan) -> dict[str, int]:
    """Return the number of one fin of each mirror pair and each single one, by what it is."""
    return {
        " ".join(word for word in plan.fins[i].word.split() if word not in ("left", "right")): i
        for i, *_ in plan.groups
    }


def study(
    count: int = 300, seed: int = 0, points: int = FINE, plan: BodyPlan = AQUAFISH
) -> list[dict[str, object]]:
    """Return the errors of the law's rule and of the others, in motions met while swimming.

    Parameters
    ----------
    count
        Trials of random bodies, and as many of the nominal one, each met three times.
    seed
        They follow from it.
    points
        Of the reference, along each side.
    plan
        Of the robots.
    """
    trials = random_trials(count, seed, plan)
    nominal = trials._replace(morphologies=np.tile(plan.nominal, (count, 1)))
    any_body, one_body = motions_met(trials), motions_met(nominal)
    records: list[dict[str, object]] = []

    def record(part: str, rule: str, points: int | None, found: Array, truth: Array) -> None:
        force, torque = relative_errors(found, truth)
        records.append(
            {"part": part, "rule": rule, "points": points, "force": force, "torque": torque}
        )

    for which, met in (("any", any_body), ("nominal", one_body)):
        for kind, i in _kinds(plan).items():
            part = f"{which} {kind}"
            size, motion = met.fins[i]
            truth = fin_reference(size, motion, points)
            record(part, "the law's", 4, drag("numba", size, motion), truth)
            for name, rule, along, across in OTHER_RULES:
                found = fin_by_rule(size, motion, rule(along), rule(across))
                record(part, f"{name} {along}x{across}", along * across, found, truth)
            record(part, SIX_FACES, None, fin_as_box(size, motion, points), truth)
    motion = any_body.bodies
    truth = body_reference(motion, points, plan)
    record("body", "the law's", None, body_by_law(motion, plan), truth)
    for strips in STRIPS:
        found = body_by_strips(plan, motion, even_strips(plan.hull, strips), 1)
        record("body", f"{strips} even strips", strips, found, truth)
    return records
