"""How many generations the starts of a search have before the best of them goes on alone."""

from __future__ import annotations

# So many starts have so many generations each, then the best of them so many more.
Table = tuple[tuple[int, int], ...]
CMA_LEGS: Table = ((6, 50), (3, 100))
POLISHING_LEGS: Table = ((6, 50), (2, 60))  # of the networks that NEAT's starts have come to


def legs(starts: int, generations: int, table: Table = CMA_LEGS) -> list[tuple[int, int]]:
    """Return how many starts go on for how many generations, the last one for the rest.

    Examples
    --------
    >>> legs(6, 750)
    [(6, 50), (3, 100), (1, 600)]
    """
    parts, left = [], generations
    for many, most in table if starts > 1 else ():
        parts.append((starts if many == table[0][0] else min(many, starts), min(most, left)))
        left -= parts[-1][1]
    return [*parts, (1, left)]


def neat(starts: int, generations: int, polish: int) -> int:
    """Return how many generations there are in all, those of polishing among them."""
    polishing = legs(starts, polish, POLISHING_LEGS)
    return starts * generations + sum(many * each for many, each in polishing)


def cma(starts: int, generations: int) -> int:
    """Return how many generations there are in all, the one in which the starts are chosen too."""
    return 1 + sum(many * each for many, each in legs(starts, generations))
