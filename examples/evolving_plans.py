"""Evolve where AquaFish's flippers stand and how large its fins are, each fish with its own gait.

    python examples/evolving_plans.py out/evolving_plans.png

A genetic algorithm draws fish of AquaFish's hull and servos, with fins no larger than AquaFish's
may be. A fish's fitness is how far the gait swims that a short search finds for it. At the end the
best fish and AquaFish have the default search each, with a seed by which no fish was chosen.
"""

import sys
from dataclasses import replace

import numpy as np

from aquafish_gym import Morphology
from aquafish_gym.plans import AQUAFISH, BodyPlan, Sizes
from aquafish_gym.rendering import render_pose
from aquafish_gym.rendering.pictures import new_figure, save_figure
from eea.core.config import GeneticConfig
from eea.core.genetic import evolve
from eea.core.genome import BitLayout, Genomes, Variable
from gait import EvolveConfig, evolve_gait, swim
from gait.plots import draw_trajectories

SHORT = EvolveConfig(restarts=1, random_candidates=100, generations=30, poses=2)
LONG = EvolveConfig(seed=1)
HULL, (LEFT, RIGHT, TAIL) = AQUAFISH.hull, AQUAFISH.fins
RANGES = {"length": (0.2, 2.0), "width": (0.1, 1.0), "thickness": (0.05, 0.5)}
SIZES = [Variable(f"{fin} {s}", 4, *RANGES[s]) for fin in ("flipper", "tail") for s in RANGES]
# Flippers farther aft would meet the tail. A kernel is compiled for each place, not for sizes.
GENES = BitLayout([Variable("along", 3, 0.0, 1.5), Variable("aside", 2, 0.7, 1.0), *SIZES])


def fish_of(genome: Genomes) -> Morphology:
    """Return the body of a genome (bits,), of a plan with its places; a flipper clears the hull."""
    along, aside, length, width, thickness, *tail = GENES.decode(genome[None])[0].tolist()
    left = replace(LEFT, hinge=(-aside, along, 0.0))
    right = replace(RIGHT, hinge=(aside, along, 0.0))
    plan = BodyPlan("evolved", HULL, (left, right, TAIL))
    flipper = Sizes(length, min(width, 2 * (aside - HULL.radius)), thickness)
    sizes = {LEFT.name: flipper, RIGHT.name: flipper, TAIL.name: Sizes(*tail)}
    return Morphology.from_array([getattr(sizes[d.fin], d.size) for d in plan.dimensions], plan)


def main(
    out: str, count: int = 16, rounds: int = 10, short: EvolveConfig = SHORT,
    long: EvolveConfig = LONG,
) -> list[float]:  # fmt: skip
    """Return how far AquaFish and the best of ``count`` fish a round swim, units; draw both."""

    def distances(genomes: Genomes) -> np.ndarray:
        fish = map(fish_of, genomes)
        found = [evolve_gait(one, replace(short, plan=one.plan)).fitness for one in fish]
        print(" ".join(f"{distance:.1f}" for distance in found), flush=True)
        return np.array(found)

    rng = np.random.default_rng(0)
    genetic = GeneticConfig(mutations=2.0)
    best, _ = evolve(GENES.random(count, rng), rounds, distances, genetic, rng)
    figure = new_figure(10.0, 6.0)
    axes = figure.subplot_mosaic([["AquaFish", "paths"], ["evolved", "paths"]])
    far, paths = [], {}
    for name, fish in (("AquaFish", Morphology.nominal()), ("evolved", fish_of(best))):
        gait = evolve_gait(fish, replace(long, plan=fish.plan))
        far.append(gait.fitness)
        print(f"{name}: {gait.fitness:.1f} units of 5 cm; {fish.plan.fins[1].hinge}, {fish}")
        at_rest = (np.zeros(3), (0.0, 0.0, 0.0, 1.0))
        axes[name].imshow(render_pose(fish, at_rest, np.zeros(3)))
        axes[name].set_title(f"{name}: {gait.fitness:.1f} units in {long.seconds:g} s")
        axes[name].set_axis_off()
        paths[name] = swim(gait.controller, fish, engine="numba", seconds=long.seconds)
    draw_trajectories(paths, axes["paths"])
    save_figure(figure, out)
    return far


if __name__ == "__main__":
    main(sys.argv[1])
