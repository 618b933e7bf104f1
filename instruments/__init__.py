"""What measures the project: verification of the physics, inference's errors and coverage, speed.

Each is a command, such as ``python -m instruments.verification``, and writes a page of the docs.
The commands of ``python -m instruments`` watch the project itself: its figures over all commits,
and whether its tests notice wrong code.
"""
