"""The simulator verified like an instrument: oracles that share as little with it as they can.

``python -m instruments.verification`` runs them all and prints what it found. Whoever changes
the drag law, the dynamics or an engine can ask the same questions again:

- :mod:`~instruments.verification.momentum`: the same robot in momentum form, by RK4;
- :mod:`~instruments.verification.quadrature`: the drag law integrated by 64 x 64 points;
- :mod:`~instruments.verification.mujoco_robot`: the same multibody, its mechanics MuJoCo's.
"""
