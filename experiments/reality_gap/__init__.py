"""Methods in worlds that their models do not know: ``python -m experiments.reality_gap``."""
