"""AquaFish in LeRobot's EnvHub: ``make_env`` returns every task of the robot fish.

Observations are ``{"agent_pos": ...}``; actions are the speeds of three servos in [-1, 1].
"""

from __future__ import annotations

from typing import Any

import gymnasium as gym

#: The tasks by their ids, in words for policies that read them.
TASKS = {
    "AquaFish-v0": "Swim forward.",
    "AquaFishStation-v0": "Hold station in a current.",
    "AquaFishWaypoint-v0": "Swim to waypoints.",
    "AquaFishRecovery-v0": "Swim forward, also after something has broken.",
    "AquaFishReturn-v0": "Swim out and back in time, also after something has broken.",
}


class LeRobotFish(gym.ObservationWrapper[dict[str, Any], Any, Any]):
    """A fish with the observations and attributes that LeRobot reads."""

    def __init__(self, env: gym.Env[Any, Any]) -> None:
        super().__init__(env)
        assert env.spec is not None
        self.observation_space = gym.spaces.Dict({"agent_pos": env.observation_space})
        self.task = env.spec.id
        self.task_description = TASKS[self.task]
        self._max_episode_steps = env.spec.max_episode_steps

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> Any:
        """Begin an episode; LeRobot adds options of its own, such as ``lerobot_new_rollout``."""
        ours = {k: v for k, v in (options or {}).items() if not k.startswith("lerobot_")}
        return super().reset(seed=seed, options=ours)

    def step(self, action: Any) -> Any:
        """Step; ``info`` has ``is_success`` for every task, which LeRobot counts."""
        observation, reward, terminated, truncated, info = super().step(action)
        return observation, reward, terminated, truncated, {"is_success": False} | info

    def observation(self, observation: Any) -> dict[str, Any]:
        """Return an observation by its name in LeRobot."""
        return {"agent_pos": observation}


def make_env(
    n_envs: int = 1, use_async_envs: bool = False, cfg: Any = None
) -> dict[str, dict[int, gym.vector.VectorEnv]]:
    """Return a batch of ``n_envs`` fish for each task: ``{"aquafish": {number: batch}}``.

    ``cfg`` is what LeRobot may pass; an attribute ``damage`` of it breaks the fish, such as
    ``"caudal:seized@4"``.
    """
    options = {"render_mode": "rgb_array", "engine": "numba"}
    if getattr(cfg, "damage", None) is not None:
        options["damage"] = cfg.damage
    kind = gym.vector.AsyncVectorEnv if use_async_envs else gym.vector.SyncVectorEnv
    mode = gym.vector.AutoresetMode.SAME_STEP  # LeRobot reads success in final_info

    def batch(name: str) -> gym.vector.VectorEnv:
        # Another process imports aquafish_gym by this name: only a forked one has it already.
        fish = [lambda: LeRobotFish(gym.make(f"aquafish_gym:{name}", **options))] * n_envs
        return kind(fish, autoreset_mode=mode)

    return {"aquafish": {number: batch(name) for number, name in enumerate(TASKS)}}
