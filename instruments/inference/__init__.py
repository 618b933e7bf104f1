"""Joint inference measured over many random robots: is it right, and is it honest?

``python -m instruments.inference`` runs every setting of :mod:`~instruments.inference.settings` and
prints the results beside their targets.
"""
