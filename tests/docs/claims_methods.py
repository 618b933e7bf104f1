"""What the pages of the paper's experiments, of gaits and of the reality gap say in numbers."""

from __future__ import annotations

from tests.docs.committed import Claim, angle_errors, figures, number, percent, recovered

FIN_GAINS = [
    100.0 * (number(path, body, "recurrent, fins") / number(path, body, "recurrent") - 1.0)
    for path in ["results/gaits/ceiling.md"]
    for body in ("whole", "left_pectoral:length=0.5", "caudal:missing")
]

CLAIMS = [
    Claim(
        "docs/gaits.md",
        "It swims {:.0f}% farther than a gait evolved for any damage and {:.0f}% farther than the "
        "old gait, in ten of ten damages each.",
        (percent("joint-fins", "randomised"), percent("joint-fins", "undamaged")),
    ),
    Claim(
        "docs/gaits.md",
        "the gain over the gait for any damage is {:.0f}%, in nine of ten",
        (percent("joint", "randomised"),),
    ),
    Claim(
        "docs/gaits.md",
        "makes {:.0f}% more in the 20 s after the damage than the gait for the true body",
        (percent("swims-on", "oracle-fins"),),
    ),
    Claim(
        "docs/gaits.md",
        "takes {:.0f} hours of swimming",
        (recovered("direct", "trials") * 20.0 / 3600.0,),
    ),
    Claim(
        "docs/gaits.md",
        "The paper's method keeps {:.0f}% of the distance of its own oracle",
        (100.0 + percent("out-of-band", "oracle-neat"),),
    ),
    Claim(
        "docs/gaits.md",
        "add {:.0f} to {:.0f}% to a recurrent network",
        (min(FIN_GAINS), max(FIN_GAINS)),
    ),
    Claim(
        "docs/results.md",
        "{:.3f}, {:.3f}, {:.3f} and {:.3f} at 128, 256, 512 and 1024 steps",
        tuple(figures("ideal", steps) for steps in (128, 256, 512, 1024)),
    ),
    Claim(
        "docs/results.md",
        "**Out-of-Band is better than in the paper**, {:.3f} instead of about 0.90.",
        (figures("out-of-band", 128, 256, 512, 1024),),
    ),
    Claim(
        "docs/results.md",
        "Out-of-Band infers the angles to {:.0f} to {:.0f} degrees, In-Band to {:.0f} to {:.0f}.",
        (
            angle_errors("out-of-band")[0],
            angle_errors("out-of-band")[-1],
            angle_errors("in-band")[0],
            angle_errors("in-band")[-1],
        ),
    ),
]
