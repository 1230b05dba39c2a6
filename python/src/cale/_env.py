"""One environment."""

from __future__ import annotations

import operator
import weakref
from typing import TYPE_CHECKING, Any

import gymnasium
import numpy as np

from cale import _core
from cale._arrays import ActionReader, StepArrays, single_action_space, single_observation_space
from cale._seeds import game_seed, random_seeds
from cale._settings import rom_hint, texts_of, with_settings
from cale._state import pack, unpack

if TYPE_CHECKING:
    from typing_extensions import Unpack

    from cale._settings_stub import Settings

_ALL = np.ones(1, np.bool_)


class Env(gymnasium.Env):
    """One Atari 2600 game, as Gymnasium has environments. `cale.make_vec` steps many of them together.

    game: "breakout", "Breakout" or "ALE/Breakout-v5".
    render_mode: None or "rgb_array".

    Observations, actions and infos are those of `cale.VectorEnv`, of one environment.
    """

    metadata: dict[str, Any] = {"render_modes": ["rgb_array"], "render_fps": 15}

    @with_settings(apart=("game", "num_envs", "env_threads"))
    def __init__(self, game: str, *, render_mode: str | None = None, **settings: Unpack[Settings]) -> None:
        """Makes the environment."""
        if render_mode not in (None, "rgb_array"):
            raise ValueError(f"render_mode must be None or 'rgb_array', not {render_mode!r}")
        if "num_envs" in settings:
            raise TypeError("an Env is one environment: cale.make_vec makes several")
        self.render_mode = render_mode
        try:
            self._core = _core.Envs(texts_of({"game": game, **settings}), _core.Autoreset.DISABLED)
        except RuntimeError as error:
            raise rom_hint(error) from None
        # Ends the environment with this object, and before the interpreter ends.
        self._finalizer = weakref.finalize(self, self._core.close)
        self.metadata = {**self.metadata, "render_fps": 60 / self._core.frame_skip}
        self.observation_space = single_observation_space(self._core)
        self.action_space = single_action_space(self._core)
        self._read_actions = ActionReader(self._core, 1)
        self._shape = tuple(self._core.observation_shape)
        self._layout = self._core.frame_skip, self._core.has_stick, self._core.has_paddle
        self._started = False

    def reset(self, *, seed: int | None = None,
              options: dict[str, Any] | None = None) -> tuple[np.ndarray, dict[str, Any]]:
        """Begins an episode, and returns the first observation and its infos.

        seed: what follows is what followed before with that seed. None: it continues with the random numbers
            that it has.
        options: `new_game`, True: a new game also where the loss of a life ended the episode; else that game
            goes on.
        """
        for name in options or {}:
            if name != "new_game":
                raise ValueError(f"there is no option {name!r} of reset: there is new_game")
        if seed is None and not self._started:
            (seed,) = random_seeds(1)
        seed = None if seed is None else operator.index(seed)
        super().reset(seed=seed)
        observation, arrays = self._new_arrays()
        seeds = [None if seed is None else game_seed(seed)]
        self._core.reset(seeds, _ALL, bool((options or {}).get("new_game", False)), arrays.core)
        self._started = True
        return observation, self._info(arrays)

    def step(self, action: Any) -> tuple[np.ndarray, float, bool, bool, dict[str, Any]]:
        """Returns observation, reward, terminated, truncated and infos of one agent step."""
        action = np.asarray(action)
        if action.shape != self.action_space.shape:
            raise ValueError(f"an action has the shape {self.action_space.shape}, not {action.shape}")
        observation, arrays = self._new_arrays()
        self._core.step(self._read_actions(action[np.newaxis]), arrays.core)
        return (observation, float(arrays.rewards[0]), bool(arrays.terminated[0]), bool(arrays.truncated[0]),
                self._info(arrays))

    def save(self) -> bytes:
        """Returns the state, exactly: `restore` continues from there as if nothing had been in between, in this
        process or another, with the same game and settings. It is the game's actions since its start, which
        `restore` plays again: about 15 s for half an hour of play."""
        return pack([self._core.save(0)])

    def restore(self, state: bytes) -> tuple[np.ndarray, dict[str, Any]]:
        """Continues from a state of `save`, or of `VectorEnv.save(index)`. Returns its observation and infos."""
        states = unpack(state)
        if len(states) != 1:
            raise ValueError(f"this state is of {len(states)} environments, not of one")
        self._core.restore(0, states[0])
        self._started = True
        observation, arrays = self._new_arrays()
        self._core.current(arrays.core)
        return observation, self._info(arrays)

    def render(self) -> np.ndarray | None:
        """Returns the game's screen in colour, [rows, 160, 3]."""
        return None if self.render_mode is None else self._core.screen(0)

    def ram(self) -> np.ndarray:
        """Returns the console's 128 bytes of memory."""
        return self._core.ram(0)

    def frame_number(self) -> int:
        """Returns how many frames were emulated since the ROM was loaded."""
        return self._core.frame_number(0)

    def action_meanings(self) -> list[str]:
        """Returns the joystick events of discrete actions; nothing for the continuous joystick."""
        return self._core.events()

    get_action_meanings = action_meanings  # ALE's name, which wrappers look for

    def close(self) -> None:
        """Ends the environment."""
        self._finalizer()

    def _new_arrays(self) -> tuple[np.ndarray, StepArrays]:
        observation = np.empty(self._shape, np.uint8)
        return observation, StepArrays(1, observation, *self._layout)

    @staticmethod
    def _info(arrays: StepArrays) -> dict[str, Any]:
        """Returns the infos, numbers of Python's where there is one number."""
        return {name: array[0].item() if array.ndim == 1 else array[0] for name, array in arrays.infos().items()}
