"""Swims: one to look at, many to score, episodes to evaluate, and a gait on two bodies."""
