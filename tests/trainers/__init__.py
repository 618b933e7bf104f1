"""Run the blocks of docs/howto/trainers.md: ``python -m tests.trainers``."""
