"""How fast everything is: ``python -m instruments.benchmarks``.

Machines are shared and noisy. So the rows of a group take turns, several times over, and a row's
ratio is to another row of its group, in this same run.
"""
