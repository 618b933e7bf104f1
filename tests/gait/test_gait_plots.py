"""The pictures are drawn from the data, without a display."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from matplotlib.figure import Figure

from aquafish_gym.morphology import Morphology
from gait.baselines import Leg
from gait.plots import (
    draw_curve,
    draw_history,
    draw_trajectories,
    plot_curve,
    plot_history,
    plot_trajectories,
)
from gait.records import Generation
from gait.rollout import swim
from gait_fakes import make_controller

HISTORY = [
    Generation(i, best, best - 1.0, 2, best, best, 3, 30) for i, best in enumerate((1.0, 0.5, 2.0))
]
CURVE = [Leg(800 * (i + 1), -1.0, score) for i, score in enumerate((1.0, 0.5, 2.0))]


def test_paths_are_drawn_from_above_and_say_how_far() -> None:
    one = swim(make_controller(), Morphology.nominal(), engine="numba", seconds=1.0)
    axes = Figure().add_subplot()
    draw_trajectories({"native": one, "target": one}, axes)
    np.testing.assert_array_equal(axes.lines[0].get_xydata(), one.position[:, :2])
    legend = axes.get_legend()
    assert legend is not None
    labels = [text.get_text() for text in legend.get_texts()]
    assert labels == [f"{name}: {one.distance:.1f}" for name in ("native", "target")]


def test_the_best_so_far_never_falls() -> None:
    axes = Figure().add_subplot()
    draw_history(HISTORY, axes)
    np.testing.assert_array_equal(axes.lines[0].get_ydata(), [1.0, 1.0, 2.0])
    axes = Figure().add_subplot()
    draw_curve(CURVE, axes)
    np.testing.assert_array_equal(axes.lines[0].get_ydata(), [1.0, 1.0, 2.0])
    np.testing.assert_array_equal(axes.lines[2].get_xydata(), [(800 * i, -1.0) for i in (1, 2, 3)])
    assert axes.get_ylabel() == "distance (units of 5 cm)"


def test_generations_are_whole_and_distances_have_a_unit() -> None:
    history, paths = Figure().subplots(1, 2)
    draw_history(HISTORY, history)
    ticks = history.get_xticks()
    np.testing.assert_array_equal(ticks, np.round(ticks))
    assert history.get_ylabel() == "distance (units of 5 cm)"
    one = swim(make_controller(), Morphology.nominal(), engine="numba", seconds=0.5)
    draw_trajectories({"native": one, "target": one}, paths)
    labels = [paths.get_xlabel(), paths.get_ylabel()]
    assert labels == ["x (units of 5 cm)", "forward, y (units of 5 cm)"]
    colours = {line.get_color() for line in paths.lines}
    assert not colours & {"#555555", "#d55e00", "#0072b2", "#009e73"}  # the case study's


@pytest.mark.parametrize("name", ["picture.png", "picture.svg"])
def test_pictures_are_written(tmp_path: Path, name: str) -> None:
    one = swim(make_controller(), Morphology.nominal(), engine="numba", seconds=0.5)
    plot_trajectories(tmp_path / name, {"native": one})
    assert (tmp_path / name).stat().st_size > 1000
    plot_history(tmp_path / name, HISTORY)
    assert (tmp_path / name).stat().st_size > 1000
    plot_curve(tmp_path / name, CURVE)
    assert (tmp_path / name).stat().st_size > 1000
    assert {path.name for path in tmp_path.iterdir()} == {name}
