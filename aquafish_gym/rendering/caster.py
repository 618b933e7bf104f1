"""Ray casting of the floor and the robots' parts into pictures, compiled by numba.

A picture has the same bytes on every CPU. The caster uses one thread, no fast-math, and only
operations that IEEE 754 rounds exactly; this excludes ``exp``.
"""

from __future__ import annotations

import functools
import math
from collections.abc import Sequence
from typing import Any

import numpy as np

from aquafish_gym.physics.compiling import compiled
from aquafish_gym.rendering import scene
from aquafish_gym.rendering.camera import NEAREST_DEPTH, CameraView, Frame
from aquafish_gym.rendering.scene import DrawnRobots
from aquafish_gym.utils.array_types import Floats

_LIGHT = (0.3492, -0.2993, 0.8880)  # direction towards the light
_VISIBILITY = 2.5  # in camera distances; there the floor has faded to 1/e
_SHADE = 0.3  # share of the floor's light that a shadow takes
_FAR = 1e9
# Content of a pixel without a part. Unseen: no part or shadow is near.
_WATER = -1
_SHADOW = -2
_UNSEEN = -3

_jit = functools.partial(compiled, error_model="numpy", nogil=True)


def draw(
    view: CameraView, floor: float, robots: Sequence[DrawnRobots], width: int, height: int
) -> tuple[Frame, Floats]:
    """Return a picture (height, width, 3) of robots in their water, over the ruled floor.

    Also return the share (height, width) of each pixel that the robots cover.
    """
    parts = np.concatenate([_parts(some) for some in robots])
    shown = np.full((height, width), _UNSEEN, np.int32)
    signs = np.array(np.meshgrid(*[(-1.0, 1.0)] * 3)).reshape(3, 8)
    for part in parts[parts[:, 0] > 0]:
        corners = part[3:6] + (part[6:15].reshape(3, 3) @ (part[:3, None] * signs)).T
        fallen = corners - np.outer((corners[:, 2] - floor) / _LIGHT[2], _LIGHT)
        for points in (corners, fallen):
            x, y, depth = view.project(points, width, height).T
            if depth.min() > NEAREST_DEPTH:
                left, right = np.clip([x.min() - 1, x.max() + 2], 0, width).astype(int)
                top, bottom = np.clip([y.min() - 1, y.max() + 2], 0, height).astype(int)
                shown[top:bottom, left:right] = _WATER
            elif depth.max() > NEAREST_DEPTH:
                shown[:] = _WATER
    picture = np.empty((height, width, 3), np.uint8)
    cover = np.zeros((height, width))
    frame = tuple(tuple(axis.tolist()) for axis in view[:4])
    camera = (*frame, 2 * view.slope / height, float(floor), _VISIBILITY * view.distance)
    colours = (scene.WATER_ABOVE, scene.WATER_BELOW, scene.SAND, scene.GRID)
    _paint_water(picture, camera, np.array(colours, float))
    _paint_robots(picture, picture.copy(), cover, shown, camera, parts)
    return picture, cover


def _parts(robots: DrawnRobots) -> Floats:
    """Return the numbers (N P, 20) of each part of robots."""
    x, y, z, w = np.moveaxis(robots.poses[..., 3:], -1, 0)
    axes = [  # as the columns of a matrix
        *(1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)),
        *(2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)),
        *(2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)),
    ]
    half = robots.sizes / 2
    centres = robots.poses[..., :3]
    table = [half, centres, np.stack(axes, axis=-1), robots.colours]
    table.append(np.sum(half**2, axis=-1, keepdims=True))  # squared radius of a bounding ball
    capsule = np.zeros((*half.shape[:-1], 1))
    capsule[:, 0] = 1.0  # the others are boxes
    table.append(capsule)
    return np.concatenate(table, axis=-1).reshape(-1, 20)


@_jit
def _fog(x: float) -> float:
    """Return about exp(-x)."""
    return 1 / (1 + x * (1 + x * (0.5 + x * (1 / 6 + x / 24))))


@_jit
def _line(at: float, spacing: float, width: float, blur: float) -> Any:
    """Return the share of a pixel of size ``blur`` that lines cover."""
    turns = at / spacing
    off = spacing * abs(turns - np.floor(turns + 0.5))
    covered = min(max((width / 2 + blur / 2 - off) / blur, 0.0), 1.0)
    return covered * min(1.0, width / blur) * max(0.0, 1 - blur / spacing)


@_jit
def _paint_water(picture: Any, camera: Any, colours: Any) -> None:
    """Write water and floor into a picture, row by row."""
    height, width = picture.shape[:2]
    eye, right, up, forward, pixel, floor, fog = camera
    line = np.zeros(width)
    for j in range(height):
        # The camera does not roll, so a row meets the floor at one depth.
        rise = (height / 2 - 0.5 - j) * pixel
        fall = forward[2] + rise * up[2]
        along = (floor - eye[2]) / fall if fall < 0 and floor < eye[2] else 0.0
        clear = _fog(along / fog) if along > 0 else 0.0
        if clear > 0.004:
            x0 = eye[0] + along * (forward[0] + rise * up[0])
            y0 = eye[1] + along * (forward[1] + rise * up[1])
            dx = along * pixel * right[0]
            dy = along * pixel * right[1]
            # A pixel on the floor extends to the next column and to the next row.
            deep = abs(up[2] * pixel / fall)
            rx = abs(dx) + along * pixel * abs(up[0])
            ry = abs(dy) + along * pixel * abs(up[1])
            for i in range(width):
                x = x0 + (i + 0.5 - width / 2) * dx
                y = y0 + (i + 0.5 - width / 2) * dy
                bx = rx + deep * abs(x - eye[0]) + 1e-9
                by = ry + deep * abs(y - eye[1]) + 1e-9
                narrow = scene.GRID_SPACING
                wide = scene.MAIN_GRID_SPACING
                thin = max(_line(x, narrow, 0.05, bx), _line(y, narrow, 0.05, by))
                thick = max(_line(x, wide, 0.1, bx), _line(y, wide, 0.1, by))
                line[i] = max(0.45 * thin, 0.8 * thick)
        for c in range(3):
            water = colours[0, c] + (j + 0.5) / height * (colours[1, c] - colours[0, c])
            sand = colours[2, c]
            mark = colours[3, c] - colours[2, c]
            for i in range(width):
                ground = sand + line[i] * mark
                picture[j, i, c] = np.uint8(water + clear * (ground - water) + 0.5)


@_jit
def _into(parts: Any, m: int, v: Any) -> tuple[float, float, float]:
    """Return a vector of the world in the axes of a part."""
    return (
        parts[m, 6] * v[0] + parts[m, 9] * v[1] + parts[m, 12] * v[2],
        parts[m, 7] * v[0] + parts[m, 10] * v[1] + parts[m, 13] * v[2],
        parts[m, 8] * v[0] + parts[m, 11] * v[1] + parts[m, 14] * v[2],
    )


@_jit
def _dot(a: Any, b: Any) -> Any:
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


@_jit
def _hit_capsule(half: Any, o: Any, d: Any) -> tuple[float, Any]:
    """Return the distance along a ray to a capsule about y, and the normal there."""
    radius = half[0]
    end = half[1] - half[0]
    a = max(d[0] * d[0] + d[2] * d[2], 1e-12)
    b = o[0] * d[0] + o[2] * d[2]
    square = b * b - a * (o[0] * o[0] + o[2] * o[2] - radius * radius)
    if square < 0:
        return _FAR, (0.0, 0.0, 0.0)
    t = -(b + math.sqrt(square)) / a
    cap = min(max(o[1] + t * d[1], -end), end)
    if cap != o[1] + t * d[1]:  # past the end of the cylinder: the ball at its end
        ball = (o[0], o[1] - cap, o[2])
        b = _dot(ball, d)
        square = b * b - _dot(ball, ball) + radius * radius
        t = -(b + math.sqrt(square)) if square >= 0 else -1.0
    if t <= 0:
        return _FAR, (0.0, 0.0, 0.0)
    normal = (o[0] + t * d[0], o[1] + t * d[1] - cap, o[2] + t * d[2])
    return t, (normal[0] / radius, normal[1] / radius, normal[2] / radius)


@_jit
def _hit_box(half: Any, o: Any, d: Any) -> tuple[float, Any]:
    """Return the distance along a ray to a box, and the normal there."""
    near = -_FAR
    far = _FAR
    axis = 0
    for k in range(3):
        slope = 1 / (d[k] if abs(d[k]) > 1e-9 else 1e-9)
        far = min(far, abs(slope) * half[k] - o[k] * slope)
        if -abs(slope) * half[k] - o[k] * slope > near:
            near = -abs(slope) * half[k] - o[k] * slope
            axis = k
    if near > far or near <= 0:
        return _FAR, (0.0, 0.0, 0.0)
    side = -1.0 if d[axis] > 0 else 1.0
    return near, (side * (axis == 0), side * (axis == 1), side * (axis == 2))


@_jit
def _trace(parts: Any, skip: int, start: Any, d: Any) -> tuple[float, int, Any]:
    """Return distance, part and normal (in the part's axes) of the first hit of a ray."""
    best = _FAR
    found = _WATER
    normal = (0.0, 0.0, 0.0)
    for m in range(len(parts)):
        q = (start[0] - parts[m, 3], start[1] - parts[m, 4], start[2] - parts[m, 5])
        b = _dot(q, d)
        if m == skip or parts[m, 0] == 0 or _dot(q, q) - b * b > parts[m, 18]:
            continue
        o = _into(parts, m, q)
        along = _into(parts, m, d)
        half = (parts[m, 0], parts[m, 1], parts[m, 2])
        t, n = _hit_capsule(half, o, along) if parts[m, 19] else _hit_box(half, o, along)
        if t < best:
            best = t
            found = m
            normal = n
    return best, found, normal


@_jit
def _look(camera: Any, parts: Any, side: float, rise: float, behind: Any) -> tuple[int, Any]:
    """Return the visible surface in a direction, and its colour.

    ``side`` and ``rise`` are the tangents to the right of the camera's axis and above it. Without
    robots the colour is ``behind``.
    """
    eye, right, up, forward, _, floor, fog = camera
    dx = forward[0] + side * right[0] + rise * up[0]
    dy = forward[1] + side * right[1] + rise * up[1]
    dz = forward[2] + side * right[2] + rise * up[2]
    length = math.sqrt(dx * dx + dy * dy + dz * dz)
    d = (dx / length, dy / length, dz / length)
    t, m, normal = _trace(parts, _WATER, eye, d)
    if m < 0:
        depth = (floor - eye[2]) / dz if dz < 0 else 0.0
        place = (eye[0] + depth * dx, eye[1] + depth * dy, floor)
        if depth <= 0 or _trace(parts, _WATER, place, _LIGHT)[1] < 0:
            return _WATER, behind
        return _SHADOW, _mix(behind, (0.0, 0.0, 0.0), _SHADE * _fog(depth / fog))
    light = _into(parts, m, _LIGHT)
    facing = _dot(normal, light)
    place = (eye[0] + t * d[0], eye[1] + t * d[1], eye[2] + t * d[2])
    lit = facing > 0 and _trace(parts, m, place, _LIGHT)[1] < 0
    bright = 0.5 + 0.18 * _dot(normal, _into(parts, m, (0.0, 0.0, 1.0)))
    gloss = 0.0
    if lit:
        bright += 0.55 * facing
        mirrored = _dot(d, _LIGHT) - 2 * facing * _dot(normal, _into(parts, m, d))
        gloss = 60 * max(mirrored, 0.0) ** 16
    red = min(parts[m, 15] * bright + gloss, 255.0)
    green = min(parts[m, 16] * bright + gloss, 255.0)
    blue = min(parts[m, 17] * bright + gloss, 255.0)
    # Faces of a box differ in their normal.
    face = 0 if parts[m, 19] else int(normal[0] + 3 * normal[1] + 5 * normal[2]) + 5
    hazy = _mix(scene.WATER_BELOW, (red, green, blue), _fog(t / (4 * fog)))
    return 32 * m + 2 * face + lit, hazy


@_jit
def _mix(a: Any, b: Any, share: float) -> tuple[float, float, float]:
    """Return a mixture of two colours."""
    return (
        a[0] + share * (b[0] - a[0]),
        a[1] + share * (b[1] - a[1]),
        a[2] + share * (b[2] - a[2]),
    )


@_jit
def _paint_robots(
    picture: Any, water: Any, cover: Any, shown: Any, camera: Any, parts: Any
) -> None:
    """Cast a ray through each pixel near a part, and four through those where surfaces meet."""
    pixel = camera[4]
    height, width = shown.shape
    for j in range(height):
        for i in range(width):
            if shown[j, i] != _UNSEEN:
                side = (i + 0.5 - width / 2) * pixel
                rise = (height / 2 - j - 0.5) * pixel
                behind = (float(water[j, i, 0]), float(water[j, i, 1]), float(water[j, i, 2]))
                shown[j, i], colour = _look(camera, parts, side, rise, behind)
                cover[j, i] = shown[j, i] >= 0
                for c in range(3):
                    picture[j, i, c] = np.uint8(colour[c] + 0.5)
    total = np.empty(3)
    for j in range(height):
        for i in range(width):
            here = shown[j, i]
            if here == _UNSEEN or (
                here == shown[max(j - 1, 0), i] == shown[min(j + 1, height - 1), i]
                and here == shown[j, max(i - 1, 0)] == shown[j, min(i + 1, width - 1)]
            ):
                continue
            total[:] = 0.5
            cover[j, i] = 0.0
            behind = (float(water[j, i, 0]), float(water[j, i, 1]), float(water[j, i, 2]))
            for k in range(4):  # at the corners of a turned square
                side = (i + (1, 5, 3, 7)[k] / 8 - width / 2) * pixel
                rise = (height / 2 - j - (3, 1, 7, 5)[k] / 8) * pixel
                what, colour = _look(camera, parts, side, rise, behind)
                cover[j, i] += (what >= 0) / 4
                for c in range(3):
                    total[c] += colour[c] / 4
            for c in range(3):
                picture[j, i, c] = np.uint8(total[c])
