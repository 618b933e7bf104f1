"""The recovery league: entrants swim on after damage, ``python -m experiments.league``."""
