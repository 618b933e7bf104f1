"""The project's figures over its commits: ``python -m instruments history``.

The other commands measure and commit files. This one reads these files at every commit, and says at
which commit a figure left its band.
"""
