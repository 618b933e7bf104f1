"""Scores of agents; the code is in :mod:`gait.scores.evaluation`."""

from gait.scores.evaluation import Agent, AgentLike, Evaluation, evaluate, interquartile_mean

__all__ = ["Agent", "AgentLike", "Evaluation", "evaluate", "interquartile_mean"]
