"""Searches for controllers: NEAT and CMA-ES behind ``ask`` and ``tell``; see ``ask_tell``."""
