"""Reference scores of controllers at every task: ``python -m experiments.scores``."""
