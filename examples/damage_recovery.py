"""The paper's case study, from damage to recovery (Sec. 5): the command ``aquafish recover``.

    python examples/damage_recovery.py --out out/recovery

A robot fish loses half of a pectoral fin. From a few blind trials it works out its new body,
evolves a gait for that body in its head, and swims on. Each step is one part of the packages,
and this is where it is written:

1. What breaks, ``aquafish_gym.Damage``: the damaged body is ``Damage.parse(...).apply(healthy)``.
2. What the robot then takes for its body, ``aquafish.recovery.treatment._self_model``: a treatment
   believes in the *undamaged* body, in the model of plain EEA (*none*) or of *out-of-band* EEA,
   in what *joint* inference holds possible or, as the *oracle*, in the true one. A model comes
   from ``eea.fish_eea``, round by round.
3. A gait for that body, or for a sample of bodies, ``gait.evolve_gait``.
4. How far that gait swims, on the believed body and on the damaged robot: ``gait.transfer``.
   Steps 2 to 4 are ``aquafish.recovery.treatment.treat``, a function of a ``Treatment`` alone.
5. Every treatment of every seed, in processes or on a cluster, each outcome written as it comes:
   ``aquafish_gym.runs.runner.run_jobs``. The same command goes on with what is missing.
6. What they say together: ``aquafish.recovery.report`` in numbers and words,
   ``aquafish.recovery.figures`` in pictures and a film.

``aquafish.recovery.command.Recover`` holds the options and joins these steps.
"""

from __future__ import annotations

import sys

from aquafish.cli import main

if __name__ == "__main__":
    sys.exit(main(["recover", *sys.argv[1:]]))
