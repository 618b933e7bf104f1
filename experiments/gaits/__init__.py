"""How far bodies can swim, ``python -m experiments.gaits``, and the agent's library of gaits."""
