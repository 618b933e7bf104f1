"""The paper's case study, from damage to recovery (Sec. 5): the command ``aquafish recover``.

    python examples/damage_recovery.py --out out/recovery

A robot fish loses half of a pectoral fin. From a few trials it infers its new body, evolves a gait
for that body in simulation, and swims on. Each step and where it is implemented:

1. Damage, ``aquafish_gym.Damage``: the damaged body is ``Damage.parse(...).apply(healthy)``.
2. The body that a treatment assumes: the *undamaged* one, the model of plain EEA (*none*) or of
   *out-of-band* EEA, the posterior of *joint* inference or, as the *oracle*, the true one. A model
   comes from ``eea.fish_eea``, round by round.
3. A gait for that body, or for a sample of bodies, ``gait.evolve_gait``.
4. The distance of that gait on the assumed body and on the damaged robot, ``gait.swims.transfer``.
   Steps 2 to 4 are ``aquafish.recovery.treatment.treat``, a pure function of a ``Treatment``.
5. Every treatment of every seed runs in worker processes or on a cluster, and each outcome is
   written when it is finished. The same command resumes.
6. The report: ``aquafish.recovery.report`` in numbers and words, ``aquafish.recovery.figures`` in
   figures and a film.

``aquafish.recovery.command.CaseStudy`` holds the options and joins these steps.
"""

from __future__ import annotations

import sys

from aquafish.cli import main

if __name__ == "__main__":
    sys.exit(main(["recover", *sys.argv[1:]]))
