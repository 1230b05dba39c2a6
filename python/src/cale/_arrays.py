"""What the environments of this package share: spaces, the arrays of a step, infos."""

from __future__ import annotations

from typing import Any

import numpy as np
from gymnasium import spaces

from cale import _core


def single_action_space(envs: _core.Envs) -> spaces.Space:
    """Returns the space of one environment's actions."""
    kind, *rest = envs.action_space
    if kind == "box":
        low, high, _names = rest
        return spaces.Box(np.array(low, np.float32), np.array(high, np.float32), dtype=np.float32)
    n, factors = rest
    return spaces.MultiDiscrete(factors) if factors else spaces.Discrete(n)


def single_observation_space(envs: _core.Envs) -> spaces.Box:
    """Returns the space of one environment's observations."""
    return spaces.Box(0, 255, tuple(envs.observation_shape), np.uint8)


class ActionReader:
    """Turns actions of Python's into those of the environments."""

    def __init__(self, envs: _core.Envs, num_envs: int) -> None:
        kind, *rest = envs.action_space
        self.factors = None if kind == "box" else rest[1]
        self.shape: tuple[int, ...] = (num_envs,)
        self.dtype: Any = np.int64
        if kind == "box":
            self.shape, self.dtype = (num_envs, len(rest[0])), np.float32
        elif self.factors:
            self.shape = (num_envs, len(self.factors))

    def __call__(self, actions: Any) -> np.ndarray:
        """Returns the actions as an array that the environments read. Throws ValueError for another shape."""
        array = np.asarray(actions)
        if array.dtype != self.dtype:
            if self.dtype is np.int64 and array.dtype.kind not in "iu":
                raise ValueError(f"actions are numbers of actions, integers, not {array.dtype}")
            array = array.astype(self.dtype)
        if array.shape != self.shape:
            raise ValueError(f"actions have the shape {self.shape}, not {array.shape}")
        if self.factors:
            there = ((array >= 0) & (array < self.factors)).all(axis=1)
            numbers = np.ravel_multi_index(tuple(array.T), self.factors, mode="clip")
            return np.where(there, numbers, -1).astype(np.int64)  # -1 is refused unless it counts for nothing
        return np.ascontiguousarray(array)


class StepArrays:
    """NumPy's arrays for what one step of all environments brings."""

    def __init__(self, num_envs: int, observations: np.ndarray | None, frame_skip: int, has_stick: bool,
                 has_paddle: bool) -> None:
        self.rewards = np.zeros(num_envs)
        self.terminated = np.zeros(num_envs, np.bool_)
        self.truncated = np.zeros(num_envs, np.bool_)
        self.episode_over = np.empty(num_envs, np.bool_)
        self.lives = np.empty(num_envs, np.int32)
        self.frames = np.empty(num_envs, np.int32)
        self.event = np.empty(num_envs, np.uint8)
        self.frame_events = np.empty((num_envs, frame_skip), np.uint8)
        self.stick = np.empty((num_envs, 3)) if has_stick else None
        self.paddle = np.empty(num_envs) if has_paddle else None
        self.core = _core.Arrays(observations, self.rewards, self.terminated, self.truncated, self.episode_over,
                                 self.lives, self.frames, self.event, self.frame_events, self.stick, self.paddle)

    def infos(self) -> dict[str, Any]:
        """Returns the infos of all environments."""
        infos = {"episode_over": self.episode_over, "lives": self.lives, "frames": self.frames, "event": self.event,
                 "frame_events": self.frame_events}
        if self.stick is not None:
            infos["stick"] = self.stick
        if self.paddle is not None:
            infos["paddle"] = self.paddle
        return infos
