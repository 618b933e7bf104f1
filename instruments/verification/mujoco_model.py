"""The robot as a MuJoCo model: sizes and masses are ours, mechanics and water MuJoCo's.

The water is one of MuJoCo's two, with the coefficients that MuJoCo gives it. In the ellipsoid model
a box is the ellipsoid whose semi-axes are half the box's sides, and a capsule likewise. The
inertia-box model has drag only, of each link as the box that has its mass and inertia.
"""

from __future__ import annotations

import math
from importlib import import_module
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from aquafish_gym.morphology import Morphology, MorphologyLike
from aquafish_gym.physics.hydrodynamics import DENSITY
from aquafish_gym.physics.robot import hull_numbers
from aquafish_gym.plans import AQUAFISH, BodyPlan, Hull
from aquafish_gym.utils.validation import (
    EngineUnavailableError,
    InvalidArgumentError,
    install_advice,
)
from instruments.verification.momentum import fin_axes, hinge_motion, robot_at
from instruments.verification.quadrature import mount_plates

BASE = 6  # degrees of freedom of the free base, before those of the hinges
VISCOSITY = 4e-4  # of water at 20 C, 1.0e-3 Pa s, in our units: 0.125 kg, 5 cm and s

# MuJoCo computes an ellipsoid's added mass by a quadrature that errs by 0.2% for a disc of this
# thickness over its width, by 12% for a tenth of it, and after that by any power of ten.
FLATTEST = 0.01
# The half size of a fin that has no face: at 1 unit/s the water pushes it with under 1e-8.
_NOTHING = 1e-6

# A servo's torque per rad/s. With some inertia in the hinge itself, any fin, however light, turns
# as told to 1e-5 rad. The base does not feel that inertia, since the hinges' motion is prescribed.
_SERVO = 1e6
_ARMATURE = 1.0

Triple = tuple[float, float, float]
Water = Literal["ellipsoid", "box"]


def load_mujoco() -> Any:
    """Return the module; :class:`EngineUnavailableError` if it is not installed."""
    try:
        return import_module("mujoco")
    except ImportError as error:
        raise EngineUnavailableError(
            f"MuJoCo is not installed here ({error}): {install_advice('mujoco')}"
        ) from None


def hinge_angles(fin_angles: NDArray[np.float64], plan: BodyPlan = AQUAFISH) -> NDArray[np.float64]:
    """Return the hinges' angles (..., F) for fin angles and phases, all in rad."""
    return hinge_motion(plan, np.asarray(fin_angles), np.zeros(len(plan.fins)))[0]


def mujoco_model(
    morphology: MorphologyLike = None, timestep: float = 0.01, water: Water | None = None
) -> Any:
    """Return the robot as an ``MjModel``: a free body and its fins' hinges, no gravity.

    ``qpos`` is position, quaternion (w, x, y, z) and the hinges' angles in rad; ``qvel`` the base's
    velocity in the world, its spin in body axes and the hinges' rates. ``ctrl`` is where servos
    bring the hinges within the next step (rad):
    their torque is proportional to what would be missing after it, and the model's integrator,
    ``implicitfast``, solves for that.

    Parameters
    ----------
    morphology
        A Morphology, or nine sizes of AquaFish; None is its nominal body.
    timestep
        Of MuJoCo's own integrator, s.
    water
        Which of MuJoCo's models, if any.

    Raises
    ------
    EngineUnavailableError
        If mujoco is not installed.
    InvalidArgumentError
        If the timestep is not positive, or the body is not one.

    References
    ----------
    MuJoCo's documentation, "Fluid forces".

    Examples
    --------
    >>> mujoco_model(None, 0.002).nv
    9
    """
    if not (isinstance(timestep, int | float) and 0 < timestep < math.inf):
        raise InvalidArgumentError(f"timestep must be a positive number of s; got {timestep!r}")
    body = morphology if isinstance(morphology, Morphology) else Morphology.coerce(morphology)
    plan = body.plan
    hull = hull_numbers(plan.hull)
    mujoco = load_mujoco()
    spec = mujoco.MjSpec()
    option, off = spec.option, mujoco.mjtDisableBit
    option.timestep = timestep
    option.gravity = [0.0, 0.0, 0.0]
    option.integrator = mujoco.mjtIntegrator.mjINT_IMPLICITFAST
    # There are no constraints; and a robot that runs away shall not be put back at the start.
    option.disableflags = off.mjDSBL_CONSTRAINT | off.mjDSBL_AUTORESET
    base = spec.worldbody.add_body(name="capsule")
    base.add_freejoint()
    _set_inertia(base, hull.mass, (0.0, 0.0, 0.0), hull.inertia)
    if water is not None:
        option.density, option.viscosity = DENSITY, VISCOSITY
    if water == "ellipsoid":
        _add_capsule(mujoco, base, plan.hull)
        for middle, axes, width, length in mount_plates(plan):
            _add_box(mujoco, base, middle, (width, length, 0.0), _quaternion(axes))
    robot = robot_at(plan, body.to_array())
    for fin_plan, fin in zip(plan.fins, robot.fins, strict=True):
        name = fin_plan.name
        # A link's axes are its fin's: width, length and normal.
        turn = _quaternion(fin_axes(fin_plan, 0.0))
        link = base.add_body(name=name, pos=fin_plan.hinge, quat=turn)
        hinges = mujoco.mjtJoint.mjJNT_HINGE
        link.add_joint(name=name, type=hinges, axis=(1.0, 0.0, 0.0), armature=_ARMATURE)
        servo = spec.add_actuator(name=name, target=name, trntype=mujoco.mjtTrn.mjTRN_JOINT)
        servo.set_to_position(kp=_SERVO / timestep, kv=_SERVO)
        centre = (0.0, -0.5 * fin.length, 0.0)
        _set_inertia(link, fin.mass, centre, fin.inertia)
        if water == "ellipsoid":
            _add_box(mujoco, link, centre, (fin.width, fin.length, fin.thickness))
    return spec.compile()


def _quaternion(axes: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the quaternion (w, x, y, z) of axes, which are columns."""
    found: NDArray[np.float64] = Rotation.from_matrix(axes).as_quat(scalar_first=True)
    return found


def _set_inertia(body: Any, mass: float, centre: Triple, inertia: Triple) -> None:
    a, b, c = inertia
    body.explicitinertial = True
    body.mass, body.ipos = mass, centre
    # A flat plate's third is the sum of the others, but for rounding, which MuJoCo refuses.
    body.inertia = (min(a, b + c), min(b, a + c), min(c, a + b))


def _add_capsule(mujoco: Any, body: Any, hull: Hull) -> None:
    half = hull.length / 2 - hull.radius
    ends = (0.0, -half, 0.0, 0.0, half, 0.0)
    size = (hull.radius, 0, 0)
    _wet(body.add_geom(type=mujoco.mjtGeom.mjGEOM_CAPSULE, size=size, fromto=ends))


def _add_box(
    mujoco: Any, body: Any, centre: Any, sizes: Triple, turn: Any = (1.0, 0.0, 0.0, 0.0)
) -> None:
    half = 0.5 * np.array(sizes)
    # A box of one size or none has no face for the water to push.
    least = FLATTEST * half.max() if np.count_nonzero(half) > 1 else _NOTHING
    half = np.maximum(half, least) if least > _NOTHING else np.full(3, _NOTHING)
    _wet(body.add_geom(type=mujoco.mjtGeom.mjGEOM_BOX, pos=centre, size=half, quat=turn))


def _wet(geom: Any) -> None:
    """Let the water push it, and nothing else."""
    geom.fluid_ellipsoid = 1.0
    geom.contype = geom.conaffinity = 0
