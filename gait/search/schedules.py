"""How many generations the starts of a search have before the best of them goes on alone."""

from __future__ import annotations

# Of NEAT, each start has so many.
NEAT_SCREENING = 15
# Of CMA-ES, so many starts have so many generations each, then the best of them so many more.
CMA_LEGS = ((6, 40), (2, 80))


def neat(starts: int, generations: int) -> int:
    """Return how many generations all starts have of which the best has ``generations``."""
    return generations + (starts - 1) * min(NEAT_SCREENING, generations)


def legs(starts: int, generations: int) -> list[tuple[int, int]]:
    """Return how many starts of CMA-ES go on for how many generations, the last one for the rest.

    Examples
    --------
    >>> legs(6, 560)
    [(6, 40), (2, 80), (1, 440)]
    """
    parts, left = [], generations
    for many, most in CMA_LEGS if starts > 1 else ():
        parts.append((starts if many == CMA_LEGS[0][0] else min(many, starts), min(most, left)))
        left -= parts[-1][1]
    return [*parts, (1, left)]


def cma(starts: int, generations: int) -> int:
    """Return how many generations there are in all, the one in which the starts are chosen too."""
    return 1 + sum(many * each for many, each in legs(starts, generations))
