"""A rectangle's added mass and inertia in potential flow, by a lattice of vortex rings."""

from __future__ import annotations

import math

import numpy as np

from aquafish_gym.physics.added_mass import plate_inertia, plate_mass

ASPECTS = (0.25, 0.5, 0.8, 1.0, 1.25, 1.5, 2.0, 2.5, 3.0, 4.0, 5.0, 8.0)  # length / width
PANELS = 8  # along half a side, of the coarsest of three lattices


def lattice_added_mass(width: float, length: float, panels: int, motion: str = "normal") -> float:
    """Return the added mass or inertia of a flat rectangle, at density 1.

    Potential flow: vortex rings side by side, whose strengths (the jumps of the potential) make
    the water move with the plate at each ring's centre. One quarter is solved for, since the
    others mirror it. The error falls with the rings' size, by its first power.

    Parameters
    ----------
    width, length
        Of the rectangle, above 0.
    panels
        Rings along half of each side.
    motion
        ``"normal"`` along the normal, ``"swing"`` about the width axis through the centre,
        ``"twist"`` about the length axis.
    """
    across, along = width / (2 * panels), length / (2 * panels)
    middle = np.arange(panels) + 0.5
    x, y = (a.ravel() for a in np.meshgrid(across * middle, along * middle, indexing="ij"))
    plate = {"normal": np.ones_like(x), "swing": y, "twist": x}[motion]
    influence = np.zeros((panels**2, panels**2))
    for side in (1, -1):
        for end in (1, -1):
            image = {"normal": 1, "swing": end, "twist": side}[motion]
            dx, dy = x[:, None] - side * x, y[:, None] - end * y
            for i in (1, -1):
                for j in (1, -1):
                    # Biot and Savart in the ring's own plane, summed over its corners.
                    cx, cy = dx + i * across / 2, dy + j * along / 2
                    influence += image * i * j * np.hypot(cx, cy) / (cx * cy)
    jumps = np.linalg.solve(influence / (4 * math.pi), plate)
    return float(4 * (jumps @ plate) * across * along)


def lattice_share(
    width: float, length: float, panels: int = PANELS, motion: str = "normal"
) -> float:
    """Return a rectangle's added mass or inertia as a share of that of as much endless strip.

    From lattices of ``panels``, twice and four times as many rings along half a side, by
    Richardson's extrapolation of the first two powers of their size.
    """
    a, b, c = (lattice_added_mass(width, length, n * panels, motion) for n in (1, 2, 4))
    strip = {
        "normal": math.pi / 4 * width**2 * length,
        "swing": math.pi / 4 * width**2 * length**3 / 12,
        "twist": math.pi / 128 * width**4 * length,
    }
    return ((8 * c - 6 * b + a) / 3) / strip[motion]


def added_mass_rows(panels: int = PANELS) -> list[dict[str, float]]:
    """Return the lattice's and the law's shares at each aspect ratio, length over width.

    Of the added mass, and of the added inertia about the width axis (the *swing*).
    """
    rows = []
    for aspect in ASPECTS:
        found = {"aspect": aspect}
        laws = {
            "normal": plate_mass(1.0, aspect) / (math.pi / 4 * aspect),
            "swing": plate_inertia(1.0, aspect) / (math.pi / 48 * aspect**3),
        }
        for motion, law in laws.items():
            share = lattice_share(1.0, aspect, panels, motion)
            found |= {
                f"{motion}_lattice": share,
                f"{motion}_law": law,
                f"{motion}_error": law / share - 1,
            }
        rows.append(found)
    return rows
