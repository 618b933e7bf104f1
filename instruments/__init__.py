"""What measures the project: verification of the physics, inference's errors and coverage, speed.

Each is a command, such as ``python -m instruments.verification``, whose results ``make pages``
shows on pages of the docs. ``python -m instruments mutants`` asks whether the tests notice wrong
code.
"""
