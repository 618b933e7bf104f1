"""The experiments behind tables of the pages, in a clone: the wheel does not contain them.

Each package is a command, such as ``python -m experiments.league``.
"""
