"""Joint inference measured over many random robots: is it right, and is it honest?

``python -m tests.inference`` runs every setting of :mod:`~tests.inference.settings` and prints the
results beside their targets.
"""
