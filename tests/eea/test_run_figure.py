from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from matplotlib.figure import Figure

from eea.core.checks import ConfigurationError
from eea.core.config import EEAConfig
from eea.core.estimation import EstimationConfig
from eea.core.exploration import ExplorationConfig
from eea.report.figures import draw_fitness, fitness_figure, save_fitness_figure
from fake_fish import STEPS, TRUTH, fake_eea

QUICK = EEAConfig(
    condition="none",
    steps=STEPS,
    rounds=3,
    exploration=ExplorationConfig(4, 2),
    estimation=EstimationConfig(population=6, generations=3),
)


def labels(figure):
    return {line.get_label(): line for line in figure.axes[0].lines}


def test_the_figure_shows_both_fitnesses_and_the_levels_beside_them():
    result = fake_eea(QUICK).run()
    lines = labels(fitness_figure(result))
    objective = next(line for label, line in lines.items() if label.startswith("OBJ_FIT"))
    model = next(line for label, line in lines.items() if label.startswith("MOD_FIT"))
    assert objective.get_ydata().tolist() == [r.objective_fitness for r in result.rounds]
    assert model.get_ydata().tolist() == [r.model_fitness for r in result.rounds]
    assert list(objective.get_xdata()) == [1, 2, 3]
    assert set(lines["random bodies"].get_ydata()) == {result.chance}
    assert set(lines["mid-range body"].get_ydata()) == {result.mid_range}
    assert set(lines["quantisation limit"].get_ydata()) == {result.nearest}


def test_without_the_truth_only_the_model_fitness_is_drawn():
    lines = labels(fitness_figure(fake_eea(QUICK, truth=False).run()))
    assert [label[:7] for label in lines] == ["MOD_FIT"]


def test_replicates_are_drawn_with_their_mean_up_to_the_shortest():
    results = [fake_eea(QUICK, 0).run(), fake_eea(replace(QUICK, rounds=2), 1).run()]
    axes = Figure().add_subplot()
    draw_fitness(axes, results)
    mean = next(line for line in axes.lines if line.get_label().startswith("OBJ_FIT"))
    first = [result.rounds[0].objective_fitness for result in results]
    assert mean.get_ydata()[0] == pytest.approx(sum(first) / 2)
    assert len(mean.get_ydata()) == 2
    assert results[0].truth.tolist() == TRUTH.tolist()


def test_a_band_reaches_a_standard_deviation_from_the_mean():
    results = [fake_eea(QUICK, seed).run() for seed in range(3)]
    axes = Figure().add_subplot()
    draw_fitness(axes, results)
    bands = {band.get_label(): band for band in axes.collections}
    assert set(bands) == {"OBJ_FIT, mean ± SD", "MOD_FIT, mean ± SD"}
    corners = bands["OBJ_FIT, mean ± SD"].get_paths()[0].vertices
    for i in range(3):
        values = [result.rounds[i].objective_fitness for result in results]
        reach = corners[corners[:, 0] == i + 1, 1]
        middle, deviation = np.mean(values), np.std(values, ddof=1)
        assert (reach.min(), reach.max()) == pytest.approx((middle - deviation, middle + deviation))
    alone = Figure().add_subplot()
    draw_fitness(alone, results[:1])
    assert not alone.collections


def test_a_fitness_below_zero_is_said_to_be_cut():
    result = fake_eea(QUICK).run()
    result.rounds = [replace(record, model_fitness=0.1) for record in result.rounds]
    assert not fitness_figure(result).axes[0].texts
    result.rounds[1] = replace(result.rounds[1], model_fitness=-3.25)
    axes = fitness_figure(result).axes[0]
    assert axes.get_ylim()[0] == 0
    assert [text.get_text() for text in axes.texts] == ["cut at 0: MOD_FIT falls to -3.25"]


def test_a_picture_appears_whole_or_not_at_all(tmp_path, monkeypatch):
    path = tmp_path / "a.png"
    path.write_bytes(b"old")
    result = fake_eea(QUICK).run()

    def fail(_figure, file, **_options):
        file.write(b"half")
        raise KeyboardInterrupt

    with monkeypatch.context() as patch:
        patch.setattr(Figure, "savefig", fail)
        with pytest.raises(KeyboardInterrupt):
            save_fitness_figure(result, path)
    assert path.read_bytes() == b"old"
    with pytest.raises(ConfigurationError, match=r"suffix must be one of .*; did you mean '.png'"):
        save_fitness_figure(result, tmp_path / "a.pmg")
    save_fitness_figure(result, path)
    assert path.read_bytes().startswith(b"\x89PNG")
    assert list(tmp_path.iterdir()) == [path]


def test_nothing_to_draw_is_refused():
    with pytest.raises(ConfigurationError, match="at least one round"):
        fitness_figure(fake_eea(QUICK).result)


def test_a_picture_is_written_without_touching_global_state(tmp_path):
    import matplotlib

    backend = matplotlib.rcParams["backend"]
    for name in ("a.png", "a.svg", "a.pdf"):
        save_fitness_figure(fake_eea(QUICK).run(), tmp_path / name)
        assert (tmp_path / name).stat().st_size > 1000
    assert matplotlib.rcParams["backend"] == backend
