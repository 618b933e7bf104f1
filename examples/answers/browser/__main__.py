"""A simulation in a page, without a server: a cart-pole of 20 lines, and the fish.

    python examples/answers/browser --out out/pages

It writes cart_pole.html and fish.html. Open them in a browser.
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import gymnasium as gym
from simulation_page import Circle, Line, Slider, trace_step, write_simulation

from aquafish_gym import Morphology, code_generation
from aquafish_gym.physics.arithmetic import add, cosine_sine, floor, subtract
from aquafish_gym.physics.kinematics import joint_angles, rotation, to_world
from aquafish_gym.physics.layout import ROBOT_ROWS, STATE_NUMBERS, fetch_state
from aquafish_gym.rendering.scene import place_parts


def balance(state: Sequence[Any], sliders: Sequence[Any]) -> Sequence[Any]:
    """Advance a cart-pole by 0.02 s: the equations of Gymnasium's CartPole-v1, and a controller."""
    x, speed, angle, rate = state
    push, gain, half, mass, gravity = sliders
    cosine, sine = cosine_sine(angle)
    force = push + gain * (x + 2.0 * speed + 35.0 * angle + 8.0 * rate)
    total = mass + 1.0
    pull = (force + mass * half * (rate * rate) * sine) / total
    turn = (gravity * sine - cosine * pull) / (
        half * (4.0 / 3.0 - mass * (cosine * cosine) / total)
    )
    drive = pull - mass * half * turn * cosine / total
    return x + 0.02 * speed, speed + 0.02 * drive, angle + 0.02 * rate, rate + 0.02 * turn


def draw_cart(state: Sequence[Any], sliders: Sequence[Any]) -> list[Line | Circle]:
    """Return the rail, the cart and its pole."""
    x, _, angle, _ = state
    half = sliders[2]
    cosine, sine = cosine_sine(angle)
    tip = x + 2.0 * half * sine, 2.0 * half * cosine
    return [
        Line(-2.4, 0.0, 2.4, 0.0, 0.02, "#9fb4c0"),
        Line(x - 0.2, 0.0, x + 0.2, 0.0, 0.22),
        Line(x, 0.0, *tip, 0.08, "#db1f1a"),
        Circle(x, 0.0, 0.05, "#ffffff"),
    ]


CART_SLIDERS = {
    "push (N)": Slider(-10.0, 10.0, 0.0),
    "controller": Slider(0.0, 1.0, 1.0),
    "half of the pole (m)": Slider(0.1, 1.0, 0.5),
    "mass of the pole (kg)": Slider(0.01, 1.0, 0.1),
    "gravity (m/s^2)": Slider(0.0, 20.0, 9.8),
}
CART_START = (0.5, 0.0, 0.2, 0.0)
CART_VIEW = (-2.6, 2.6, -1.2, 2.2)

FISH_SLIDERS = {
    "left flipper (rev/s)": Slider(-0.5, 0.5, 0.3),
    "right flipper (rev/s)": Slider(-0.5, 0.5, 0.3),
    "tail (Hz)": Slider(0.0, 1.0, 1.0),
    "length of the left flipper (5 cm)": Slider(0.0, 1.6, 1.6),
    "current from the left (units/s)": Slider(-0.5, 0.5, 0.0),
}
LEFT_LENGTH = 1  # of the nine sizes
FISH_VIEW = (-6.0, 6.0, -5.0, 5.0)
COLOURS = ("#9ea3ab", "#61666e", "#61666e", "#db1f1a", "#db1f1a", "#db1f1a")


def body(length: Any) -> list[Any]:
    """Return the nine sizes of the fish with a left flipper of another length."""
    sizes: list[Any] = Morphology.nominal().to_array().tolist()
    sizes[LEFT_LENGTH] = length
    return sizes


def swim(state: Sequence[Any], sliders: Sequence[Any]) -> Sequence[Any]:
    """Advance the fish by 0.01 s, by the simulator's own functions."""
    left, right, tail, length, current = sliders
    robot: list[Any] = [0.0] * ROBOT_ROWS
    code_generation.robot_rows(body(length), [1.0], [1.0, 1.0], robot)
    after = list(state)
    code_generation.step(after, robot, [current, 0.0, 0.0], [left, right, tail])
    return after


def draw_fish(state: Sequence[Any], sliders: Sequence[Any]) -> list[Line | Circle]:
    """Return the fish from above, north up, with marks in the water two units apart."""
    now = fetch_state(list(state), 0, 1, 0.0)
    axes = rotation(now.orientation)
    east, north, _ = now.position
    shapes: list[Line | Circle] = []
    for column in range(-3, 5):
        for row in range(-3, 4):
            x = 2.0 * column - (east - 2.0 * floor(east * 0.5))
            y = 2.0 * row - (north - 2.0 * floor(north * 0.5))
            shapes.append(Circle(x, y, 0.05, "#b9d3de"))
    parts = place_parts(body(sliders[3]), (0.0, 0.0, 0.0), joint_angles(now))
    for part, colour in zip(parts[: len(COLOURS)], COLOURS, strict=True):
        width, length, _ = part.size
        reach = 0.5 * (length - width)  # to the round ends
        way = to_world(rotation(part.turn), (0.0, reach, 0.0))
        ahead = to_world(axes, way)
        middle = to_world(axes, part.centre)
        (x, y, _), (to_x, to_y, _) = add(middle, ahead), subtract(middle, ahead)
        shapes.append(Line(x, y, to_x, to_y, width, colour))
    return shapes


def fish_at_rest() -> list[float]:
    """Return the state of a fish at rest."""
    state = [0.0] * STATE_NUMBERS
    code_generation.start([0.0, 0.0, 0.0], state)
    return state


def apart_from_gymnasium() -> tuple[float, int]:
    """Return how far the cart-pole is from CartPole-v1 until that falls, and in how many steps."""
    env: Any = gym.make("CartPole-v1").unwrapped
    env.reset(seed=0)
    state: Sequence[Any] = tuple(map(float, env.state))
    apart = 0.0
    steps = 0
    terminated = False
    while not terminated:
        action = steps % 3 % 2
        terminated = env.step(action)[2]
        state = balance(state, (10.0 if action else -10.0, 0.0, 0.5, 0.1, 9.8))
        apart = max(apart, *(abs(a - b) for a, b in zip(state, env.state, strict=True)))
        steps += 1
    return apart, steps


def main(out: Path | None = None) -> None:
    """Write both pages, and print what is in them."""
    with TemporaryDirectory() as folder:
        place = out or Path(folder)
        place.mkdir(parents=True, exist_ok=True)
        cart = write_simulation(
            place / "cart_pole.html", balance, draw_cart, CART_START, CART_SLIDERS, 0.02, CART_VIEW,
            "A cart-pole", "Push it, and take the controller away.",
        )  # fmt: skip
        fish = write_simulation(
            place / "fish.html", swim, draw_fish, fish_at_rest(), FISH_SLIDERS, 0.01, FISH_VIEW,
            "The fish, from above", "Shorten a flipper while it swims.",
        )  # fmt: skip
        for path, step, start, sliders in (
            (cart, balance, CART_START, CART_SLIDERS),
            (fish, swim, fish_at_rest(), FISH_SLIDERS),
        ):
            operations = trace_step(step, len(start), len(sliders)).operations.total()
            size = path.stat().st_size / 1000
            print(f"{path.name}: {size:.0f} kB, {operations} operations a step")
    apart, steps = apart_from_gymnasium()
    agrees = "equals" if apart < 1e-12 else f"is {apart:.0e} from"
    print(f"the cart-pole {agrees} Gymnasium's for {steps} steps, until that falls")


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--out", type=Path, default=Path("out/pages"))
    main(parser.parse_args().out)
