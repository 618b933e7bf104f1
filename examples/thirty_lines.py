"""Swim the fish, break a fin, let it model itself, evolve a gait: the README's thirty lines."""

import gymnasium as gym

import aquafish_gym  # noqa: F401  # registers AquaFish-v0
from aquafish_gym import Damage, Morphology
from eea import estimate_morphology
from gait import EvolveConfig, evolve_gait, swim

# Swim the fish: three servo commands in [-1, 1], five times a second.
env = gym.make("AquaFish-v0")
observation, info = env.reset(seed=0)
env.action_space.seed(0)
for _ in range(25):
    observation, reward, terminated, truncated, info = env.step(env.action_space.sample())
print(f"random commands: {info['y_position']:+.2f} units forward in 5 s")

# Break a fin.
healthy = Morphology.nominal()
damage = Damage.parse("left_pectoral:length=0.5")
broken = damage.apply(healthy)

# From three blind trials of 2.56 s, work out what the robot has become.
estimate = estimate_morphology(
    healthy, damage, seed=0,
    progress=lambda r: print(f"trial {r.round}: OBJ_FIT {r.objective_fitness:.3f}"),
)  # fmt: skip

# Evolve a gait for the old body, for the self-model, and swim both on the broken robot.
for name, body in (("old body", healthy), ("self-model", estimate.morphology)):
    gait = evolve_gait(body, EvolveConfig(seed=0, search="cma"))
    print(f"gait for the {name}: {swim(gait.controller, broken).distance:+.1f} units in 20 s")
