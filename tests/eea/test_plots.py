from __future__ import annotations

from dataclasses import replace

from eea.core.config import EstimationConfig, ExplorationConfig, PaperConfig
from eea.fish.plots import fitness_figure
from fake_fish import STEPS, fake_eea

QUICK = PaperConfig(
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


def test_a_fitness_below_zero_does_not_squash_the_rest():
    result = fake_eea(QUICK).run()
    result.rounds[1] = replace(result.rounds[1], model_fitness=-3.25)
    assert fitness_figure(result).axes[0].get_ylim()[0] == 0
