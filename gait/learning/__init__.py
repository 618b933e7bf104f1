"""PPO for comparison, and environments for stable-baselines3."""
