"""Joint inference measured over many random robots: is it right, and is it honest?

``python -m tests.inference`` runs every setting of :mod:`~tests.inference.settings` and prints what
it found beside what was asked of it. Whoever changes the search, the posterior or the goodness test
can ask the same questions again.
"""
