"""Trained policies: acting by one, and playing games with it."""

from __future__ import annotations

import operator
import os
import warnings
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from cale import _core
from cale._env import Env
from cale._settings import require_utf8, rom_hint, text_of, texts_of
from cale._vector_env import VectorEnv

_FACTORS = (3, 3, 2)  # choices of x, of y and of the button
_OF_GYMNASIUM = ("autoreset_mode", "copy", "render_mode")  # arguments of environments that are no settings


class Policy:
    """A trained policy, from a file that `cale export` made (docs/policy_file.md). It is computed without any
    other library; opening a file executes nothing of it. `info` is what the file says beside the weights, a dictionary.

    seed: of the actions that are drawn.
    """

    def __init__(self, file: str | bytes | os.PathLike[str], *, seed: int = 0) -> None:
        file = require_utf8("file", os.fsdecode(file))
        self._core = _core.Policy(file)
        self._core.seed(_seed(seed))
        self.file = Path(file)
        self.info: dict[str, Any] = self._core.info

    def act(self, observations: Any, choice: str = "greedy") -> np.ndarray:
        """Returns an action for each of N observations, or the action for one: as an environment with
        `settings` takes them. Where the network chooses coordinates they are (r, theta, fire), whatever these are,
        or (position, fire) of an absolute paddle, float32 [N, 3 or 2]; of a factored policy its three choices, int64 [N, 3];
        else numbers of actions, int64 [N]. Throws ValueError for observations of another shape or type.

        choice: "greedy", "sampled" (drawn from the policy; with action values only the noise of noisy layers is), or
            "as_evaluated", as its training's evaluations did.
        """
        batch, single = self._batch(observations)
        count = len(batch)
        coordinates, actions = np.empty((count, self._core.axes), np.float32), np.empty(count, np.int64)
        self._core.act(batch, choice, coordinates, actions)
        result: np.ndarray
        if not self.info["actions"]:
            result = coordinates
        elif self.info["joystick"] == "factored":
            result = np.stack(np.unravel_index(actions, _FACTORS), axis=1)
        else:
            result = actions
        return result[0] if single else result

    def output(self, observations: Any) -> np.ndarray:
        """Returns what the network gives for each observation, float32 [N, numbers]: means and logarithms of
        standard deviations of the joystick's coordinates before the tanh, log-probabilities of actions, or their values.
        """
        batch, single = self._batch(observations)
        numbers = np.empty((len(batch), self._core.output_size), np.float32)
        self._core.output(batch, numbers)
        return numbers[0] if single else numbers

    def values(self, observations: Any) -> np.ndarray:
        """Returns the value of the best action for each observation, float32 [N]. Throws TypeError for a policy that
        knows no values."""
        if not self._core.gives_action_values:
            raise TypeError(f"the policies of {self.info['agent']} know no action values")
        return self.output(observations).max(axis=-1)

    @property
    def settings(self) -> dict[str, str]:
        """Returns the settings of the environment that the policy was trained in, for `cale.make_vec` and `Env`, with the
        `joystick` whose coordinates `act()` writes."""
        settings = settings_in(self.info["provenance"].get("config", ""))
        if not settings:
            raise ValueError(f"{self.file} does not say which settings it was trained with")
        for name in ("rom_dir", "num_envs", "env_threads"):
            settings.pop(name, None)
        if unknown := settings.keys() - {setting["name"] for setting in _core.settings()}:
            raise ValueError(f"{self.file} is of a newer cale: this one does not know its setting {min(unknown)!r}")
        if not self.info["actions"]:
            settings["joystick"] = "polar"  # act() writes (r, theta, fire); where it places a paddle, this counts for nothing
        return settings

    def make_vec(self, num_envs: int = 1, **changes: Any) -> VectorEnv:
        """Returns N environments like the one that the policy was trained in, with `changes`. Throws ValueError for
        actions or observations that are not the policy's."""
        return VectorEnv(num_envs=num_envs, **self._changed(changes))

    def make_env(self, **changes: Any) -> Env:
        """Returns one of them."""
        return Env(**self._changed(changes))

    def _changed(self, changes: dict[str, Any]) -> dict[str, Any]:
        settings = self.settings
        written = settings.get("joystick", "polar")
        if (asked := text_of("joystick", changes.get("joystick", written))) != written:
            raise ValueError(f"joystick={asked}: this policy's act() writes {written} coordinates")
        changed = {**settings, **changes}
        texts = texts_of({name: value for name, value in changed.items() if name not in _OF_GYMNASIUM})
        try:
            _core.require_playable(self._core, texts)
        except RuntimeError as error:
            raise rom_hint(error) from None
        return changed

    def __repr__(self) -> str:
        return f"Policy({str(self.file)!r}): {self.info['agent']} on {self.info['game']}"

    def _batch(self, observations: Any) -> tuple[np.ndarray, bool]:
        """Returns the observations as N of them, and whether they were one."""
        shape = tuple(self.info["observation_shape"])
        array = np.asarray(observations)
        if array.dtype != np.uint8 or array.shape[-len(shape):] != shape or array.ndim > len(shape) + 1:
            raise ValueError(f"observations are uint8 [N, {', '.join(map(str, shape))}], "
                             f"not {array.dtype} {list(array.shape)}")
        single = array.ndim == len(shape)
        return np.ascontiguousarray(array[np.newaxis] if single else array), single


def settings_in(config: str) -> dict[str, str]:
    """Returns the environment's settings in a run's configuration, as `train_*` writes it into a policy's file:
    the lines `  name: value` below `env:`."""
    settings: dict[str, str] = {}
    section = ""
    for line in config.splitlines():
        if not line.startswith(" "):
            section = line
        elif section == "env:":
            name, _, value = line.strip().partition(": ")
            settings[name] = value.strip('"')
    return settings


def _seed(seed: int) -> int:
    """Returns the seed as an int. Throws ValueError unless it is from 0 to 2**64 - 1."""
    if not 0 <= seed < 2**64:
        raise ValueError(f"seed is {seed}: it must be from 0 to 2**64 - 1")
    return operator.index(seed)


@dataclass(frozen=True, eq=False)
class Evaluation:
    """Games played by a policy: an entry of each array is a game, by its number."""

    returns: np.ndarray
    """undiscounted, neither clipped nor scaled"""
    lengths: np.ndarray
    """agent steps"""
    frames: np.ndarray
    """emulated"""

    @property
    def mean(self) -> float:
        """The mean return."""
        return float(self.returns.mean())

    @property
    def standard_deviation(self) -> float:
        """Of the returns, divided by n."""
        return float(self.returns.std())

    def __eq__(self, other: object) -> bool:
        """Returns whether the games are the same ones."""
        return isinstance(other, Evaluation) and all(
            np.array_equal(getattr(self, column), getattr(other, column)) for column in ("returns", "lengths", "frames"))


def evaluate(policy: Policy | str | os.PathLike[str], games: int = 100, *, seed: int = 1, epsilon: float = 0.001,
             noop_max: int = 29, sampled: bool | None = None, threads: int | None = None,
             **changes: Any) -> Evaluation:
    """Plays whole games with a policy, without learning, as `cale evaluate` does: in the environment that it was
    trained in, with `changes`. Game i follows from `seed` and i alone.

    epsilon: probability of a uniformly random action instead of the policy's.
    noop_max: a game begins with 0 to this many no-op agent steps.
    sampled: whether actions are drawn from the policy, as `Policy.act` does it; None: as its training's evaluations did.
    threads: games under way at a time; None: as many as there are cores for this process.
    """
    policy = policy if isinstance(policy, Policy) else Policy(policy)
    if games < 1:
        raise ValueError(f"games is {games}: it must be at least 1")
    seed = _seed(seed)
    if threads is not None and threads < 1:
        raise ValueError(f"threads is {threads}: it must be at least 1")
    if not 0 <= epsilon <= 1:
        raise ValueError(f"epsilon is {epsilon}: it must lie in [0, 1]")
    life_loss = "true" if policy.info["life_loss_ends_episode"] else "false"  # what the policy sees depends on it
    asked = changes.get("terminal_on_life_loss")
    if asked is not None and text_of("terminal_on_life_loss", asked) != life_loss:
        warnings.warn(f"terminal_on_life_loss={asked} is not applied: as in this policy's training ({life_loss}), a lost life "
                      f"{'clears' if life_loss == 'true' else 'does not clear'} its frame stack; no game ends with a life",
                      stacklevel=2)
    texts = texts_of({**policy.settings, "noop_max": noop_max, **changes, "terminal_on_life_loss": life_loss})
    drawn = policy.info["evaluation_samples"] if sampled is None else sampled
    stop = _core.Stop()
    try:
        _core.require_playable(policy._core, texts)
        with ThreadPoolExecutor(threads or len(os.sched_getaffinity(0))) as pool:
            try:
                results = list(pool.map(
                    lambda number: _core.play_game(policy._core, texts, epsilon, drawn, seed, number, stop), range(games)))
            except BaseException:  # such as Ctrl-C
                stop.request()
                pool.shutdown(wait=False, cancel_futures=True)
                raise
    except RuntimeError as error:
        raise rom_hint(error) from None
    returns, lengths, frames = (np.array(column) for column in zip(*results))
    return Evaluation(returns, lengths, frames)
