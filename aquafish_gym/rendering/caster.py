"""Pictures by casting rays at the floor and at the robots' parts, compiled by numba.

A picture has the same bytes on every CPU: it takes one thread, no fast-math, and only operations
that IEEE 754 rounds exactly, which excludes ``exp``.

A robot is an array (n, 20) with a row for each part: whether it is a capsule, half its size (3),
its centre (3), its axes as the columns of a matrix (9), its colour (3) and the square of the radius
of a ball that holds it.
"""

from __future__ import annotations

import functools
import math
from collections.abc import Sequence
from typing import Any

import numpy as np

from aquafish_gym.physics.compiling import compiled
from aquafish_gym.rendering import scene
from aquafish_gym.rendering.camera import NEAREST, Frame, View
from aquafish_gym.rendering.scene import Floats, Part

_HALF, _CENTRE, _AXES, _COLOUR, _BALL = 1, 4, 7, 16, 19
_LIGHT = (0.3492, -0.2993, 0.8880)  # the direction towards it
_VISIBILITY = 2.5  # of the camera's distance, where the floor has faded to 1/e
_SHADE = 0.3  # share of the floor's light that a shadow takes
_TEXELS = 96  # of a robot's shadow, in each direction
_FAR = 1e9
_WATER, _UNSEEN = -1, -2  # what a pixel shows in place of a surface; no part is near

_jit = functools.partial(compiled, error_model="numpy", nogil=True)


def solid_parts(parts: Sequence[Part], poses: Floats) -> Floats:
    """Return a robot (n, 20) of parts at poses (n, 7)."""
    half = np.array([part.size for part in parts]) / 2
    x, y, z, w = poses[:, 3:].T
    axes = [
        *(1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)),
        *(2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)),
        *(2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)),
    ]
    capsule, colour = [p.kind == "capsule" for p in parts], [p.colour for p in parts]
    ball = np.sum(half**2, axis=1)
    return np.column_stack([capsule, half, poses[:, :3], np.transpose(axes), colour, ball])


def draw_water(
    view: View, floor: float, robots: Sequence[Floats], width: int, height: int
) -> Frame:
    """Return a picture of the water and its ruled floor, with the robots' soft shadows."""
    shades = np.zeros((len(robots), _TEXELS, _TEXELS))
    places = np.zeros((len(robots), 3))
    for robot, shade, place in zip(robots, shades, places, strict=True):
        centre, reach = robot[:, _CENTRE : _CENTRE + 3], np.sqrt(robot[:, _BALL:]) / _LIGHT[2]
        middle = centre[:, :2] - (centre[:, 2:] - floor) / _LIGHT[2] * _LIGHT[:2]
        low, high = (middle - reach).min(axis=0), (middle + reach).max(axis=0)
        texel = max(high - low) / (_TEXELS - 8)
        place[:] = *(low - 4 * texel), texel
        _cast_shadow(shade, place, floor, robot)
        for axis in (0, 1, 0, 1):  # softens edges
            shade += np.roll(shade, 1, axis) + np.roll(shade, -1, axis)
            shade /= 3
    colours = (scene.WATER_ABOVE, scene.WATER_BELOW, scene.SAND, scene.GRID)
    ruling = (scene.GRID_SPACING, scene.MAIN_GRID_SPACING)
    picture = np.empty((height, width, 3), np.uint8)
    _paint_water(
        picture, np.array(view[:4]), 2 * view.slope / height, _VISIBILITY * view.distance, floor,
        ruling, np.array(colours, float), shades * _SHADE, places,
    )  # fmt: skip
    return picture


def draw_robots(picture: Frame, view: View, robots: Sequence[Floats]) -> None:
    """Draw robots into a picture (height, width, 3)."""
    height, width = picture.shape[:2]
    parts = np.concatenate(robots)
    shown = np.full((height, width), _UNSEEN, np.int32)
    signs = np.array(np.meshgrid(*[(-1.0, 1.0)] * 3)).reshape(3, 8)
    for part in parts:
        corners = part[_AXES:_COLOUR].reshape(3, 3) @ (part[_HALF:_CENTRE, None] * signs)
        x, y, depth = view.project(part[_CENTRE:_AXES] + corners.T, width, height).T
        if depth.min() > NEAREST:
            left, right = np.clip([x.min() - 1, x.max() + 2], 0, width).astype(int)
            top, bottom = np.clip([y.min() - 1, y.max() + 2], 0, height).astype(int)
            shown[top:bottom, left:right] = _WATER
        elif depth.max() > NEAREST:
            shown[:] = _WATER
    water, fog = np.array(scene.WATER_BELOW, float), 4 * _VISIBILITY * view.distance
    pixel = 2 * view.slope / height
    _paint_robots(picture, picture.copy(), shown, np.array(view[:4]), pixel, fog, water, parts)


@_jit
def _fog(x: float) -> float:
    """Return about exp(-x)."""
    return 1 / (1 + x * (1 + x * (0.5 + x * (1 / 6 + x / 24))))


@_jit
def _line(at: float, spacing: float, width: float, blur: float) -> Any:
    """Return how much of a pixel of size ``blur`` is covered by lines, 0 to 1."""
    turns = at / spacing
    off = spacing * abs(turns - np.floor(turns + 0.5))
    covered = min(max((width / 2 + blur / 2 - off) / blur, 0.0), 1.0)
    return covered * min(1.0, width / blur) * max(0.0, 1 - blur / spacing)


@_jit
def _paint_water(
    picture: Any, view: Any, pixel: float, fog: float, floor: float,
    ruling: Any, colours: Any, shades: Any, places: Any,
) -> None:  # fmt: skip
    height, width = picture.shape[:2]
    eye, right, up, forward = view[0], view[1], view[2], view[3]
    line, light = np.empty(width), np.empty(width)
    for j in range(height):
        # The camera does not roll, so a row meets the floor at one depth.
        rise = (height / 2 - 0.5 - j) * pixel
        fall = forward[2] + rise * up[2]
        along = (floor - eye[2]) / fall if fall < 0 and floor < eye[2] else 0.0
        clear = _fog(along / fog) if along > 0 else 0.0
        light[:] = 1.0
        if clear > 0.004:
            x0, y0 = (
                eye[0] + along * (forward[0] + rise * up[0]),
                eye[1] + along * (forward[1] + rise * up[1]),
            )
            dx, dy = along * pixel * right[0], along * pixel * right[1]
            # The extent of a pixel on the floor is that to the next column and to the next row.
            deep = abs(up[2] * pixel / fall)
            rx, ry = abs(dx) + along * pixel * abs(up[0]), abs(dy) + along * pixel * abs(up[1])
            for i in range(width):
                x, y = x0 + (i + 0.5 - width / 2) * dx, y0 + (i + 0.5 - width / 2) * dy
                bx, by = rx + deep * abs(x - eye[0]) + 1e-9, ry + deep * abs(y - eye[1]) + 1e-9
                thin = max(_line(x, ruling[0], 0.05, bx), _line(y, ruling[0], 0.05, by))
                thick = max(_line(x, ruling[1], 0.1, bx), _line(y, ruling[1], 0.1, by))
                line[i] = max(0.45 * thin, 0.8 * thick)
            for k in range(len(shades)):
                texel = places[k, 2]
                for i in range(width):
                    u = (x0 + (i + 0.5 - width / 2) * dx - places[k, 0]) / texel - 0.5
                    v = (y0 + (i + 0.5 - width / 2) * dy - places[k, 1]) / texel - 0.5
                    if 0 <= u < _TEXELS - 1 and 0 <= v < _TEXELS - 1:
                        light[i] *= 1 - _between(shades[k], u, v)
        for c in range(3):
            water = colours[0, c] + (j + 0.5) / height * (colours[1, c] - colours[0, c])
            sand, mark = colours[2, c], colours[3, c] - colours[2, c]
            for i in range(width):
                ground = light[i] * (sand + line[i] * mark)
                picture[j, i, c] = np.uint8(water + clear * (ground - water) + 0.5)


@_jit
def _between(table: Any, u: float, v: float) -> Any:
    """Return a table's value between its entries."""
    m, n = int(u), int(v)
    u, v = u - m, v - n
    first = table[m, n] + v * (table[m, n + 1] - table[m, n])
    return first + u * (table[m + 1, n] + v * (table[m + 1, n + 1] - table[m + 1, n]) - first)


@_jit
def _cast_shadow(shade: Any, place: Any, floor: float, solids: Any) -> None:
    """Write 1 where a square of the floor, of a side and from a corner in ``place``, is dark."""
    for i in range(_TEXELS):
        for j in range(_TEXELS):
            x, y = place[0] + (i + 0.5) * place[2], place[1] + (j + 0.5) * place[2]
            shade[i, j] = _trace(solids, -1, (x, y, floor), _LIGHT)[1] >= 0


@_jit
def _into(solids: Any, m: int, v: Any) -> tuple[float, float, float]:
    """Return a vector of the world in a part's own axes."""
    return (
        solids[m, 7] * v[0] + solids[m, 10] * v[1] + solids[m, 13] * v[2],
        solids[m, 8] * v[0] + solids[m, 11] * v[1] + solids[m, 14] * v[2],
        solids[m, 9] * v[0] + solids[m, 12] * v[1] + solids[m, 15] * v[2],
    )


@_jit
def _dot(a: Any, b: Any) -> Any:
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


@_jit
def _hit_capsule(radius: float, end: float, o: Any, d: Any) -> tuple[float, Any]:
    """Return the distance along a ray to a capsule about y, and the normal there."""
    a = max(d[0] * d[0] + d[2] * d[2], 1e-12)
    b = o[0] * d[0] + o[2] * d[2]
    square = b * b - a * (o[0] * o[0] + o[2] * o[2] - radius * radius)
    if square < 0:
        return _FAR, (0.0, 0.0, 0.0)
    t = -(b + math.sqrt(square)) / a
    cap = min(max(o[1] + t * d[1], -end), end)
    if cap != o[1] + t * d[1]:  # past the cylinder's end: the ball there
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
    """Return the same of a box."""
    near, far, axis = -_FAR, _FAR, 0
    for k in range(3):
        slope = 1 / (d[k] if abs(d[k]) > 1e-9 else 1e-9)
        far = min(far, abs(slope) * half[k] - o[k] * slope)
        if -abs(slope) * half[k] - o[k] * slope > near:
            near, axis = -abs(slope) * half[k] - o[k] * slope, k
    if near > far or near <= 0:
        return _FAR, (0.0, 0.0, 0.0)
    side = -1.0 if d[axis] > 0 else 1.0
    return near, (side * (axis == 0), side * (axis == 1), side * (axis == 2))


@_jit
def _trace(solids: Any, skip: int, start: Any, d: Any) -> tuple[float, int, Any]:
    """Return distance, part and normal, in its own axes, of what a ray hits first."""
    best, part, normal = _FAR, -1, (0.0, 0.0, 0.0)
    for m in range(len(solids)):
        q = (start[0] - solids[m, 4], start[1] - solids[m, 5], start[2] - solids[m, 6])
        b = _dot(q, d)
        if m == skip or _dot(q, q) - b * b > solids[m, _BALL]:
            continue
        o, along = _into(solids, m, q), _into(solids, m, d)
        half = (solids[m, 1], solids[m, 2], solids[m, 3])
        if solids[m, 0]:
            t, n = _hit_capsule(half[0], half[1] - half[0], o, along)
        else:
            t, n = _hit_box(half, o, along)
        if t < best:
            best, part, normal = t, m, n
    return best, part, normal


@_jit
def _look(
    view: Any, fog: float, water: Any, solids: Any, side: float, rise: float
) -> tuple[int, Any]:
    """Return which surface is seen in a direction, and its colour."""
    eye = (view[0, 0], view[0, 1], view[0, 2])
    dx = view[3, 0] + side * view[1, 0] + rise * view[2, 0]
    dy = view[3, 1] + side * view[1, 1] + rise * view[2, 1]
    dz = view[3, 2] + side * view[1, 2] + rise * view[2, 2]
    length = math.sqrt(dx * dx + dy * dy + dz * dz)
    d = (dx / length, dy / length, dz / length)
    t, part, normal = _trace(solids, -1, eye, d)
    if part < 0:
        return _WATER, (0.0, 0.0, 0.0)
    light = _into(solids, part, _LIGHT)
    facing = _dot(normal, light)
    lit = facing > 0
    if lit:
        place = (eye[0] + t * d[0], eye[1] + t * d[1], eye[2] + t * d[2])
        lit = _trace(solids, part, place, _LIGHT)[1] < 0
    bright, gloss = 0.5 + 0.18 * _dot(normal, _into(solids, part, (0.0, 0.0, 1.0))), 0.0
    if lit:
        bright += 0.55 * facing
        mirrored = _dot(d, _LIGHT) - 2 * facing * _dot(normal, _into(solids, part, d))
        gloss = 60 * max(mirrored, 0.0) ** 16
    # Faces of a box differ in their normal.
    face = 0 if solids[part, 0] else int(normal[0] + 3 * normal[1] + 5 * normal[2]) + 5
    clear = _fog(t / fog)
    red = water[0] + clear * (min(solids[part, 16] * bright + gloss, 255.0) - water[0])
    green = water[1] + clear * (min(solids[part, 17] * bright + gloss, 255.0) - water[1])
    blue = water[2] + clear * (min(solids[part, 18] * bright + gloss, 255.0) - water[2])
    return 32 * part + 2 * face + lit, (red, green, blue)


@_jit
def _paint_robots(
    picture: Any, behind: Any, shown: Any, view: Any, pixel: float, fog: float, water: Any,
    solids: Any,
) -> None:  # fmt: skip
    """Cast a ray through each pixel near a part, and four through those where surfaces meet."""
    height, width = shown.shape
    for j in range(height):
        for i in range(width):
            if shown[j, i] != _UNSEEN:
                side, rise = (i + 0.5 - width / 2) * pixel, (height / 2 - j - 0.5) * pixel
                shown[j, i], colour = _look(view, fog, water, solids, side, rise)
                if shown[j, i] != _WATER:
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
            for k in range(4):  # at the corners of a turned square
                side = (i + (1, 5, 3, 7)[k] / 8 - width / 2) * pixel
                rise = (height / 2 - j - (3, 1, 7, 5)[k] / 8) * pixel
                what, colour = _look(view, fog, water, solids, side, rise)
                for c in range(3):
                    total[c] += (behind[j, i, c] if what == _WATER else colour[c]) / 4
            for c in range(3):
                picture[j, i, c] = np.uint8(total[c])
