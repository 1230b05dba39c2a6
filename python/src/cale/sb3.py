"""Vector environments for Stable-Baselines3, which has an interface of its own:

    from cale.sb3 import SB3VecEnv
    model = PPO("CnnPolicy", SB3VecEnv(cale.make_vec("breakout", num_envs=8, autoreset_mode="SameStep")))
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from gymnasium.vector import AutoresetMode
from stable_baselines3.common.vec_env import VecEnv

from cale._vector_env import VectorEnv


class SB3VecEnv(VecEnv):
    """The environments of a `cale.VectorEnv` as Stable-Baselines3 steps them. Its autoreset mode must be SAME_STEP,
    and `copy` true.
    Wrap it in SB3's VecMonitor for returns of episodes in the log."""

    def __init__(self, envs: VectorEnv) -> None:
        if envs.autoreset_mode is not AutoresetMode.SAME_STEP:
            raise ValueError("Stable-Baselines3 resets environments in the same step: "
                             "make them with autoreset_mode='SameStep'")
        if not envs.copy:
            raise ValueError("Stable-Baselines3 keeps observations beyond the next step: make them with copy=True")
        self.envs = envs
        self.render_mode = envs.render_mode
        self._wanted_seed: list[int] | None = None
        self._under_way = False
        super().__init__(envs.num_envs, envs.single_observation_space, envs.single_action_space)
        self.metadata = {**self.metadata, "render_fps": envs.metadata["render_fps"]}

    def reset(self) -> np.ndarray:
        """Begins episodes everywhere, and returns their first observations. A step that is under way is dropped."""
        if self._under_way:
            self.step_wait()
        options = self._options[0]
        if any(other != options for other in self._options):
            raise ValueError("set_options() takes one dictionary here: the environments are reset together")
        observations, infos = self.envs.reset(seed=self._wanted_seed, options=options)
        self._wanted_seed = None
        self._reset_options()
        self.reset_infos = self._listed(infos)
        return observations

    def step_async(self, actions: np.ndarray) -> None:
        """Begins a step in the background."""
        self.envs.send(actions)
        self._under_way = True

    def step_wait(self) -> tuple[np.ndarray, np.ndarray, np.ndarray, list[dict[str, Any]]]:
        """Returns observations, rewards, ends and infos of the step that was begun."""
        self._under_way = False
        observations, rewards, terminated, truncated, infos = self.envs.recv()
        ended = terminated | truncated
        listed = self._listed(infos)
        last = self._listed(infos["final_info"]) if ended.any() else []
        for i in np.flatnonzero(ended):
            self.reset_infos[i] = listed[i]
            listed[i] = last[i]
            listed[i]["terminal_observation"] = infos["final_obs"][i]
            listed[i]["TimeLimit.truncated"] = bool(truncated[i] and not terminated[i])
        return observations, rewards.astype(np.float32), ended, listed

    def seed(self, seed: int | None = None) -> Sequence[int | None]:
        """Seeds the environments with seed, seed + 1, ... from the next reset on."""
        first = int(np.random.randint(0, 2**31 - 1)) if seed is None else seed
        self._wanted_seed = [first + i for i in range(self.num_envs)]
        return self._wanted_seed

    def close(self) -> None:
        """Ends the environments."""
        self.envs.close()

    def get_images(self) -> Sequence[np.ndarray | None]:
        """Returns the games' screens."""
        return self.envs.render() or [None] * self.num_envs

    def get_attr(self, attr_name: str, indices: Any = None) -> list[Any]:
        """Returns an attribute of the vector environment, once for each environment."""
        return [getattr(self.envs, attr_name)] * len(list(self._get_indices(indices)))

    def set_attr(self, attr_name: str, value: Any, indices: Any = None) -> None:
        """Sets an attribute of the vector environment. Refuses a part of the environments."""
        self._require_all(indices)
        setattr(self.envs, attr_name, value)

    def env_method(self, method_name: str, *args: Any, indices: Any = None, **kwargs: Any) -> list[Any]:
        """Calls a method of the vector environment, once, and returns its result for each environment. Refuses a part
        of the environments."""
        self._require_all(indices)
        return [getattr(self.envs, method_name)(*args, **kwargs)] * self.num_envs

    def env_is_wrapped(self, wrapper_class: type, indices: Any = None) -> list[bool]:
        """Returns that no environment is wrapped."""
        return [False] * len(list(self._get_indices(indices)))

    def _require_all(self, indices: Any) -> None:
        """The environments are one object: what is called or set holds for all of them."""
        if sorted(self._get_indices(indices)) != list(range(self.num_envs)):
            raise ValueError(f"indices={indices!r}: these environments are one object; leave indices out")

    @staticmethod
    def _listed(infos: dict[str, Any]) -> list[dict[str, Any]]:
        """Returns the infos as a dictionary for each environment, with numbers of Python's where there is one number."""
        names = [name for name in infos if not name.startswith("_") and name not in ("final_obs", "final_info")]
        columns = [infos[name].tolist() if infos[name].ndim == 1 else infos[name] for name in names]
        return [dict(zip(names, row)) for row in zip(*columns)]
