"""What the pages of the physics, of inference and of real robots say in numbers."""

from __future__ import annotations

from tests.docs.committed import Claim, cell, document, physics, worst_quadrature

FOREIGN = "results/inference/foreign.md"

CLAIMS = [
    Claim(
        "docs/validation.md",
        "With a hull twice as heavy, at 0.01 rad/s, half of the fits pass as good, and their "
        "intervals hold {}.",
        (cell(FOREIGN, "hull 100% heavier *|0.01", "of good fits"),),
    ),
    Claim(
        "docs/validation.md",
        "With a turned gyroscope or slow servos, at 0.03 rad/s, one fit of eight passes as good, "
        "and its intervals hold {}.",
        (cell(FOREIGN, "gyroscope turned by 3 degrees|0.03", "of good fits"),),
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
        "in units of 6.25 mN, and the simulator's is {:.4f}",
        (document("physics/report.json")["reactive"]["held"][0]["reactive"],),
    ),
    Claim(
        "docs/physics_appendix.md",
        "float32 is at most {:.1e} units from float64 after 5.12 s, and {:.1e} units after 20 s.",
        tuple(
            physics("single_precision", what="position", seconds=seconds)["maximum"]
            for seconds in (5.12, 20.0)
        ),
    ),
]
