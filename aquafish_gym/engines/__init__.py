"""The two engines, PyBullet and the compiled one, which simulate the same robot.

``api`` simulates whole trials on either, ``worlds`` robots step by step, ``packages`` knows
which are installed; ``compiled`` and ``bullet`` are the engines themselves.
"""
