"""What the pages of the physics, of inference and of real robots say in numbers."""

from __future__ import annotations

import re
from statistics import mean
from typing import Any

from aquafish_gym.engines.cuda import REGISTERS
from aquafish_gym.physics.hydrodynamics import (
    AXIAL_DRAG,
    CROSS_FLOW_DRAG,
    NORMAL_DRAG,
    SKIN_FRICTION,
)
from aquafish_gym.physics.robot import MOUNT_LENGTH
from aquafish_gym.plans.aquafish import AQUAFISH
from eea.fish import joint
from eea.fish.known import CHANGE_PROBABILITY
from eea.fish.simulator_error import CONTRADICTED_P
from instruments.verification.fish_data import BEAT, BIAS_RUNS, BIAS_SECONDS
from instruments.verification.real_fish import BIASES
from instruments.verification.tail_swims import SUBSTEPS
from tests.docs.committed import (
    DOCS,
    WORDS,
    Claim,
    cell,
    document,
    fraction,
    numbers,
    physics,
    rows,
    worst_quadrature,
)

FOREIGN = "results/inference/foreign.md"
ROBOTS_OF_A_WORLD = 8
HULL = AQUAFISH.hull
FLIPPER, _, TAIL = AQUAFISH.fins
REPORT = document("physics/report.json")
LATTICE = REPORT["reactive"]["added_mass"]
FISH = REPORT["real_fish"]
MEASURED = FISH["published"]
TURN_IN_A_BEAT = BIAS_RUNS[0][1] * BEAT / BIAS_SECONDS  # at a bias of 20 degrees
COVERAGE = [
    setting["coverage"]
    for setting in document("inference/report.json")["settings"].values()
    if setting["robots"] == 80
]
HALF_WIDTHS = [
    (one["interval"][1] - one["interval"][0]) / 2.0
    for shares in COVERAGE
    for one in shares.values()
]
GPU = (DOCS / "results/performance/gpu.md").read_text(encoding="utf-8")
MULTIPROCESSORS = int(re.findall(r"(\d+) multiprocessors", GPU)[0])
SWIMMER = document("real/fish.json")
DRONES = document("real/drones.json")
AUV = document("real/auv.json")
COURSES = [one["beats"] for one in REPORT["reactive"]["course"] if one["beats"]]


def on_gpu(engine: str, loop: str) -> tuple[float, float]:
    """Return the rates of the most robots, in G robot-steps/s: of the loop, and of a whole call."""
    row = rf"{engine} +float32 +([\d,]+) robots, +(\d+) steps, {loop} *: +([\d.]+) .*\(([\d.]+) s"
    found = re.findall(row, GPU)
    assert found, f"docs/results/performance/gpu.md has no row of {engine}, {loop}"
    robots, steps, rate, seconds = (float(one.replace(",", "")) for one in found[-1])
    return rate, robots * steps / seconds / 1e9


def benchmark(group: str, row: str) -> float:
    """Return the first rate of a row of a benchmark in millions a second."""
    text = (DOCS / f"results/performance/{group}.md").read_text(encoding="utf-8")
    found = re.search(rf" {row} .*? ([\d.]+) M/s", text)
    assert found
    return float(found[1])


def bad_fits(world: str, noise: str) -> int:
    """Return how many fits of robots in another world are said to be bad."""
    share = float(cell(FOREIGN, f"{world}|{noise}", "said to be bad").strip("%"))
    return round(share / 100.0 * ROBOTS_OF_A_WORLD)


def good_fits(world: str, noise: str) -> tuple[str, str]:
    """Return how many fits pass as good, and the share of the sizes that their intervals hold."""
    count = ROBOTS_OF_A_WORLD - bad_fits(world, noise)
    return WORDS[count], cell(FOREIGN, f"{world}|{noise}", "of good fits")


WORLDS = [row[0] for row in rows(FOREIGN)[1:] if row[1] == "0.01"]
SLOW = "servo time constant 0.1 s *"
DENSE = "fins twice as dense, skin friction x 5 *"


def begun(swimmer: str, reactive: bool, key: str = "slope") -> list[float]:
    """Return exponents of speed in amplitude after 6, 8 and 10 beats from rest."""
    return [
        row[key]
        for rows in FISH["from rest"]
        for row in rows
        if (row["swimmer"], row["reactive"]) == (swimmer, reactive)
    ]


def steady(swimmer: str, reactive: bool, part: str = "amplitude") -> dict[str, Any]:
    """Return the row of a steady swimmer."""
    return physics("real_fish", part, swimmer=swimmer, reactive=reactive)


def turn(reactive: bool, end: str) -> float:
    """Return an end of the range of the 18 tails' turns in a beat, at a bias of 20 degrees."""
    (row,) = (one for one in FISH["turning"] if (one["reactive"], one["bias"]) == (reactive, 15))
    return float(row[end]) * BIAS_RUNS[0][0] / BIASES[-1]


CLAIMS = [
    Claim(
        "docs/validation.md",
        "With slow servos, at 0.03 rad/s, {} fit of eight passes as good, and its intervals hold "
        "{}.",
        good_fits(SLOW, "0.03"),
    ),
    Claim(
        "docs/validation.md",
        "With fins twice as dense and five times the skin friction, {} fit of eight passes as good "
        "at 0.01 rad/s, and its intervals hold {}. At 0.03 rad/s {} of eight do, and hold {}.",
        (*good_fits(DENSE, "0.01"), *good_fits(DENSE, "0.03")),
        {row[0] for row in rows(FOREIGN)[1:] if row[-1] != "yes"} == {SLOW, DENSE},
    ),
    Claim(
        "docs/physics_appendix.md",
        "At 0.01 s it is {:.3f} units in the median of twenty robots, and {:.3f} units at most.",
        tuple(
            physics("convergence", what="position", step=0.01)[key] for key in ("median", "maximum")
        ),
    ),
    Claim(
        "docs/physics_appendix.md",
        "The law's rms error is at most {:.1f}% of the rms force or torque, on fins and body.",
        (worst_quadrature(),),
    ),
    Claim(
        "docs/physics_appendix.md",
        "It moves a path of 5.12 s by {:.3f} units in the median.",
        (physics("quadrature", "paths", what="position")["median"],),
    ),
    Claim(
        "docs/physics_appendix.md",
        "Robots turn about {} as fast as in our water.",
        (fraction(physics("foreign", water="MuJoCo's")["strength"]["median"]),),
    ),
    Claim(
        "docs/physics_appendix.md",
        "{:.4f} in units of 6.25 mN, and the simulator's is {:.4f}",
        (REPORT["reactive"]["held"][0]["lighthill"], REPORT["reactive"]["held"][0]["reactive"]),
    ),
    Claim(
        "docs/physics_appendix.md",
        "float32 is at most {:.1e} units from float64 after 5.12 s, and {:.1e} units after 20 s.",
        tuple(
            physics("single_precision", what="position", seconds=seconds)["maximum"]
            for seconds in (5.12, 20.0)
        ),
    ),
    *(
        Claim(
            page,
            "within {:.1f}% (mass) and {:.1f}% (inertia)",
            tuple(
                100.0 * max(abs(row[f"{what}_error"]) for row in LATTICE)
                for what in ("normal", "swing")
            ),
        )
        for page in ("docs/physics.md", "docs/physics_appendix.md")
    ),
    Claim(
        "docs/physics.md",
        "to [under {:.0f}% of the rms of the force](physics_appendix.md#quadrature)",
        (worst_quadrature(),),
    ),
    Claim(
        "docs/physics.md",
        "a tiny disturbance makes a thin tail lose its course after {:.0f} to {:.0f} beats.",
        (min(COURSES), max(COURSES)),
    ),
    Claim(
        "docs/physics.md",
        "a capsule of radius {:g} with a cylinder {:g} long, {:g} in all",
        (HULL.radius, HULL.length - 2.0 * HULL.radius, HULL.length),
    ),
    Claim(
        "docs/physics.md",
        "x = ±{:g}, {:.1f} behind the nose",
        (abs(FLIPPER.hinge[0]), HULL.length / 2.0 - FLIPPER.hinge[1]),
    ),
    Claim(
        "docs/physics.md",
        "a plate {:g} x {:g} from body to hinge",
        (abs(FLIPPER.hinge[0]) - HULL.radius, MOUNT_LENGTH),
    ),
    Claim(
        "docs/physics.md",
        "nominal flipper | {:g} wide, {:g} long, {:g} thick",
        (FLIPPER.nominal.width, FLIPPER.nominal.length, FLIPPER.nominal.thickness),
    ),
    Claim(
        "docs/physics.md",
        "nominal tail | {:g} high, {:g} long, {:g} thick",
        (TAIL.nominal.width, TAIL.nominal.length, TAIL.nominal.thickness),
    ),
    Claim("docs/physics.md", "C_N above | {:g} |", (NORMAL_DRAG,)),
    Claim("docs/physics.md", "C_f above | {:g} |", (SKIN_FRICTION,)),
    Claim("docs/physics.md", "on the whole surface | {:g} |", (SKIN_FRICTION,)),
    Claim("docs/physics.md", "V_xz, in strips | {:g} |", (CROSS_FLOW_DRAG,)),
    Claim("docs/physics.md", "abs(vy) vy | {:.2f} |", (AXIAL_DRAG,)),
    Claim(
        "docs/real_fish.md",
        "**On drag alone that power is {:.1f} to {:.1f}, twice what was measured.**",
        (min(begun("nominal robot", False)), max(begun("nominal robot", False))),
    ),
    Claim(
        "docs/real_fish.md",
        "at Strouhal numbers of {:.1f} to {:.1f}.",
        (steady("18 tails", True)["strouhal"]["low"], steady("nominal robot", True)["strouhal"]),
    ),
    Claim(
        "docs/real_fish.md",
        "On drag alone the nominal robot's Strouhal number is about {:.0f},",
        (steady("nominal robot", False)["strouhal"],),
    ),
    Claim(
        "docs/real_fish.md",
        "after 6, 8, 10 beats | {:.2f}, {:.2f}, {:.2f} | medians of 18 tails {:.1f}, {:.1f}, "
        "{:.1f}; each tail above the interval | **{:.2f}, {:.2f}, {:.2f}**; ranges of {:.2f} to "
        "{:.2f} |",
        (
            *(one["slope"] for one in MEASURED["amplitude"]),
            *begun("18 tails", False),
            *begun("18 tails", True),
            min(begun("18 tails", True, "low")),
            max(begun("18 tails", True, "high")),
        ),
        holds=all(
            low > one["high"]
            for low, one in zip(begun("18 tails", False, "low"), MEASURED["amplitude"], strict=True)
        ),
    ),
    Claim(
        "docs/real_fish.md",
        "| {:.2f} with a soft tail, {:.2f} in live fish |",
        (MEASURED["frequency"]["slope"], MEASURED["bainbridge"]),
    ),
    Claim(
        "docs/real_fish.md",
        "| {:.2f} rad at a bias of 20 degrees | at most {:.0%} of that | **inside the range** of "
        "18 tails |",
        (TURN_IN_A_BEAT, turn(False, "high") / TURN_IN_A_BEAT),
        holds=turn(True, "low") < TURN_IN_A_BEAT < turn(True, "high"),
    ),
    Claim(
        "docs/real_fish.md",
        "it takes {:.2f} off the nominal robot's exponent.",
        (1.0 - steady("nominal robot", False, "coarse")["slope"],),
    ),
    Claim("docs/real_fish.md", "has {:.2f} from 5 to 22.5 Hz.", (MEASURED["bainbridge"],)),
    Claim(
        "docs/real_fish.md",
        "is steeper, {:.2f} (Michelis",
        (MEASURED["frequency"]["slope"],),
    ),
    Claim("docs/real_fish.md", "explains {:.2f} of that.", (MEASURED["tip"],)),
    Claim(
        "docs/real_fish.md",
        "Its Strouhal numbers, {:.1f} to {:.1f},",
        (
            min(one["strouhal"] for one in MEASURED["strouhal"]),
            max(one["strouhal"] for one in MEASURED["strouhal"]),
        ),
    ),
    Claim(
        "docs/real_fish.md",
        "Half of the {:,} steps a beat change no exponent by more than {:.2f}.",
        (100 * SUBSTEPS, FISH["step_error"]),
    ),
    Claim(
        "docs/inference.md",
        "three axes | sd {:g} units/s |",
        (joint.CURRENTS["current x"].sd,),
    ),
    Claim(
        "docs/inference.md",
        "the drag of the body | sd {:g} about 1 |",
        (joint.NUISANCES["drag of the body"].sd,),
    ),
    Claim(
        "docs/inference.md",
        "on all servo speeds | sd {:g} about 1 |",
        (joint.NUISANCES["servo gain"].sd,),
    ),
    Claim(
        "docs/inference.md",
        "of the gyroscope | sd {:g} rad/s |",
        (joint.NUISANCES["gyro bias x"].sd,),
    ),
    Claim("docs/inference.md", "half normal, sd {:g} s |", (joint.NUISANCES["lag"].sd,)),
    Claim("docs/inference.md", "(p < {:g})", (CONTRADICTED_P,)),
    Claim("docs/inference.md", "White residuals above {:g} rad/s", (joint.LOUDEST_NOISE,)),
    Claim(
        "docs/inference.md",
        "normal with sd {:g} units/s, and an unknown part of the spin, {:g} rad/s.",
        (joint.STARTS["start velocity x"].sd, joint.STARTS["start spin x"].sd),
    ),
    Claim("docs/inference.md", "with a chance of {:g}, independently", (CHANGE_PROBABILITY,)),
    Claim(
        "docs/inference.md",
        "mass of the hull ({:.0%}), a scale of the gyroscope of {:.0%}, and its turn of {:g} rad",
        (joint.HULL_MASS_SD, joint.GYRO_SCALE_SD, joint.GYRO_MOUNTING_SD),
    ),
    Claim(
        "docs/validation.md",
        "The 95% intervals of these shares reach {:.0%} to {:.0%} either way with 80 robots.",
        (min(HALF_WIDTHS), max(HALF_WIDTHS)),
    ),
    Claim(
        "docs/validation.md",
        "So their 50% intervals hold {:.0%} to {:.0%};",
        (
            min(shares["50%"]["share"] for shares in COVERAGE),
            max(shares["50%"]["share"] for shares in COVERAGE),
        ),
    ),
    Claim(
        "docs/performance.md",
        "{} multiprocessors of 128 lanes at 1.98 GHz do {:.0f} T instructions a second, or {:.0f} "
        "G steps of about a thousand. The open loop reaches {:.0%} of that: a thread takes {} "
        "registers, so that only {} of 64 warps share a multiprocessor.",
        (
            MULTIPROCESSORS,
            MULTIPROCESSORS * 128 * 1.98 / 1000.0,
            MULTIPROCESSORS * 128 * 1.98 / 1000.0,
            on_gpu("cuda", "open")[0] / (MULTIPROCESSORS * 128 * 1.98 / 1000.0),
            REGISTERS["float32"],
            65_536 // (32 * REGISTERS["float32"]),
        ),
    ),
    Claim(
        "docs/performance.md",
        "1,024 robots swim a step of 0.2 s in {:.1f} ms,",
        (1024 / 1000.0 / benchmark("environments", "of which physics"),),
    ),
    Claim(
        "docs/validation.md",
        "At 0.01 rad/s {} of {} fits are said to be bad, though most of their intervals hold.",
        (sum(bad_fits(one, "0.01") for one in WORLDS), ROBOTS_OF_A_WORLD * len(WORLDS)),
        holds=all(numbers(FOREIGN, f"{one}|0.01", "90%")[0] > 50.0 for one in WORLDS),
    ),
    Claim(
        "docs/physics_appendix.md",
        "It is of first order and halves with the step.",
        holds=all(
            abs(one["order"] - 1.0) < 0.02
            for one in REPORT["convergence"]["rows"]
            if one["order"] is not None
        ),
    ),
    Claim(
        "docs/physics_appendix.md",
        "**A beating tail pulls the fish backward there**",
        holds=max(physics("foreign", water="MuJoCo's")["tails"]) < 0.0,
    ),
    Claim(
        "docs/performance.md",
        "**A log takes longer to bring back than to make**, and longer than {} cores take to swim "
        "the robots.",
        (re.findall(r"(\d+) cores", GPU)[0],),
        holds=on_gpu("cuda", "open, logged")[1]
        < min(on_gpu("cuda", "open, logged")[0] / 2.0, on_gpu("numba", "open, logged")[0]),
    ),
    Claim(
        "docs/real_robots.md",
        "{} predictions of 2 s and {} of 5 s:",
        (SWIMMER["cases"]["2"], SWIMMER["cases"]["5"]),
    ),
    Claim("docs/real_robots.md", "Our 90% intervals hold {:.0%}.", (SWIMMER["held_90"],)),
    Claim(
        "docs/real_robots.md",
        "the tail comes out {:.0f} cm long and {:.0f} cm high.",
        tuple(100.0 * mean(SWIMMER["numbers"][one]) for one in ("tail_length", "tail_height")),
    ),
    Claim(
        "docs/real_robots.md",
        "A cut below {:.1f} mm would not show in one flight against healthy flights of the same "
        "build, one below {:.1f} mm not against those of other builds.",
        (DRONES["would_not_show_mm"], DRONES["other_builds"]["would_not_show_mm"]),
    ),
    Claim(
        "docs/real_robots.md",
        "In both sessions of 9 April the flights of other builds tell nothing:",
        holds=all(
            DRONES["other_builds"]["rmse_mm"][one] == DRONES["other_builds"]["rmse_of_zero_mm"][one]
            for one in ("E8, 9 April", "E9, 9 April")
        ),
    ),
    Claim(
        "docs/real_robots.md",
        "The prior odds are {:.0f} to 1 against each fault, at which at most 10% of healthy swims "
        "are called broken:",
        (AUV["odds"],),
        AUV["false_alarms"] <= 0.1,
    ),
    Claim("docs/real_robots.md", "The rotors' rate, {:.1f} Hz,", (mean(AUV["rotor_hz"]),)),
    Claim(
        "docs/real_robots.md",
        "With the rate of the rotors from the fifty known swims alone, a badly damaged propeller "
        "is named in {:.1%}.",
        (AUV["rotor_of_known"]["thruster_bad"],),
    ),
]
#: What `examples/compare_conditions.py` prints; docs/provenance.md has its commit.
COMPARED = {
    *("0.000", "0.015", "0.019", "0.033", "0.041"),
    *("0.694", "0.697", "0.800", "0.887", "0.913", "0.966", "0.993", "1.000"),
}
#: Numbers of methods and of cited works.
SETTINGS: dict[str, set[str]] = {
    # With two probabilities that show how a finding is worded.
    "docs/inference.md": COMPARED | {"0.01", "2.56", "29%", "71%", "90%"},
    "docs/validation.md": {
        *("0.05", "0.1"),
        *("5%", "50%", "80%", "90%", "95%", "99%"),
    },
    "docs/physics.md": {
        *("0.01", "0.125", "6.25"),  # the time step and the units
        *("0.491", "0.749", "0.997", "3.07"),  # of the paper's Fig. 4
        *("0.34", "0.68", "0.74", "1.17", "1.98"),  # of handbooks
        *("0.02", "0.4", "0.6", "1.4"),  # tails
    },
    "docs/physics_appendix.md": {"5.12", "0.26", "0.49", "1.71"},  # three are of formulas
    "docs/real_fish.md": {
        "95%",
        *("0.02", "0.2", "0.4", "0.6", "1.4"),  # tails, and Strouhal numbers of animals
        "0.26",  # of Clark et al., 2012
    },
    "docs/performance.md": {"0.01", "90%"},
    "docs/real_robots.md": {"0.1", "0.75", "0.8", "1.5", "5%", "one of four"},
}
