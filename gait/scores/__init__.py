"""How far controllers swim: rollouts, fitness, transfer to another body, scores in environments."""
