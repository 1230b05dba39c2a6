"""N environments that step together."""

from __future__ import annotations

import operator
import weakref
from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Any

import gymnasium
import numpy as np
from gymnasium.vector import AutoresetMode
from gymnasium.vector.utils import batch_space

from cale import _core
from cale._arrays import ActionReader, StepArrays, single_action_space, single_observation_space
from cale._seeds import game_seed, random_seeds
from cale._settings import rom_hint, texts_of, with_settings
from cale._state import pack, unpack

if TYPE_CHECKING:
    from typing_extensions import Unpack

    from cale._settings_stub import Settings

_RESET_OPTIONS = ("reset_mask", "new_game")


class VectorEnv(gymnasium.vector.VectorEnv):
    """N Atari 2600 games that step together, on threads of their own; as Gymnasium has vector environments.

    Observations: [N, stack, 84, 84] screens in grey, newest last, or [N, stack, 128] bytes of memory (more with
    `observe_joystick`); uint8.
    Actions: by default the continuous joystick, (r, theta, fire) in [0, 1] x [-pi, pi] x [0, 1].
    Infos, an array of N each: `lives`; `frames`, emulated in the step; `event`, the joystick event that the
    action stood for, and `frame_events`, what the console saw in each frame; `episode_over`, whether the game
    itself is over or cut off (an episode also ends with a life where `terminal_on_life_loss` is set); `stick`,
    (x, y, button), where the joystick moves (`stick_speed` and the like); `paddle`, its position, where actions
    place it (`paddle="absolute"`). With SAME_STEP, an episode that ended
    leaves `final_obs` and `final_info`, as in Gymnasium.

    game: the game, or several, which the environments play in turn: `games` says what each plays.
    num_envs: how many environments.
    autoreset_mode: when the next episode begins; Gymnasium's NEXT_STEP, SAME_STEP or DISABLED, or one of these names.
    copy: True: every step returns new arrays. False: it returns the same ones, which the next step overwrites;
        they must not be written to.
    render_mode: None or "rgb_array".
    """

    metadata: dict[str, Any] = {"render_modes": ["rgb_array"], "render_fps": 15}
    # Gymnasium before 1.3 closes what is deleted, also where it could not be made.
    _finalizer: Callable[[], Any] = staticmethod(lambda: None)

    @with_settings(apart=("game", "num_envs"))
    def __init__(self, game: str | Sequence[str], num_envs: int = 1, *, autoreset_mode: AutoresetMode | str = AutoresetMode.NEXT_STEP,
                 copy: bool = True, render_mode: str | None = None, **settings: Unpack[Settings]) -> None:
        """Makes the environments."""
        if render_mode not in (None, "rgb_array"):
            raise ValueError(f"render_mode must be None or 'rgb_array', not {render_mode!r}")
        self.autoreset_mode = _autoreset_mode(autoreset_mode)
        self.copy = copy
        self.render_mode = render_mode
        texts = texts_of({"game": game, "num_envs": num_envs, **settings})
        try:
            self._core = _core.Envs(texts, _core.Autoreset[self.autoreset_mode.name])
        except RuntimeError as error:
            raise rom_hint(error) from None
        # Ends the environments with this object, and before the interpreter ends.
        self._finalizer = weakref.finalize(self, self._core.close)

        self.num_envs = self._core.num_envs
        self.games = tuple(self._core.games)
        self._frame_skip = self._core.frame_skip
        self.metadata = {**self.metadata, "autoreset_mode": self.autoreset_mode, "render_fps": 60 / self._frame_skip}
        self.single_observation_space = single_observation_space(self._core)
        self.single_action_space = single_action_space(self._core)
        self.observation_space = batch_space(self.single_observation_space, self.num_envs)
        self.action_space = batch_space(self.single_action_space, self.num_envs)
        self._read_actions = ActionReader(self._core, self.num_envs)
        self._shape = (self.num_envs, *self._core.observation_shape)
        self._has = self._core.has_stick, self._core.has_paddle
        self._stacks = self._core.stacks
        self._kept = None if copy else self._new_arrays()[1]
        self._started = False

    def reset(self, *, seed: int | Sequence[int | None] | np.ndarray | None = None,
              options: dict[str, Any] | None = None) -> tuple[np.ndarray, dict[str, Any]]:
        """Begins new episodes, and returns the first observations and infos.

        seed: environment i gets seed + i, or the i-th of a sequence, and repeats what it did with that seed
            before. None: it continues with the random numbers that it has.
        options: `reset_mask`, an array of bool: only where it is True; the other environments stay as they are.
            `new_game`: True: a new game also where the loss of a life ended the episode; else that game goes on.
        """
        mask, new_game = self._reset_options(options or {})
        if not self._started:
            if not mask.all():
                raise ValueError("the first reset must be of all environments: leave options['reset_mask'] out")
            if seed is None:
                (seed,) = random_seeds(1)
        if isinstance(seed, (int, np.integer)):
            super().reset(seed=int(seed))
            seeds: list[int | None] = [int(seed) + i for i in range(self.num_envs)]
        else:
            if seed is not None and (isinstance(seed, (str, bytes)) or not isinstance(seed, (Sequence, np.ndarray))):
                raise TypeError(f"seed is {seed!r}: give an integer, or a sequence of one for each environment")
            seeds = [None] * self.num_envs if seed is None else [None if s is None else operator.index(s) for s in seed]
        if len(seeds) != self.num_envs:
            raise ValueError(f"seed has {len(seeds)} entries: give one, or one for each of {self.num_envs} environments")
        if not self._started and None in seeds:
            seeds = [new if old is None else old for new, old in zip(random_seeds(self.num_envs), seeds)]
        observations, arrays = self._arrays()
        self._core.reset([None if s is None else game_seed(s) for s in seeds], mask, new_game, arrays.core)
        self._started = True
        return observations, self._infos(arrays, mask)

    def step(self, actions: Any) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray, dict[str, Any]]:
        """Returns observations, rewards, terminated, truncated and infos of one agent step of all environments."""
        observations, arrays = self._arrays()
        self._core.step(self._read_actions(actions), arrays.core)
        return self._result(observations, arrays)

    def send(self, actions: Any) -> None:
        """Begins a step in the background, and returns at once: `recv` returns what `step` would have."""
        observations, arrays = self._arrays()
        self._core.send(self._read_actions(actions), arrays.core, (observations, arrays))

    def recv(self) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray, dict[str, Any]]:
        """Waits for the step that `send` began, and returns what it brought."""
        return self._result(*self._core.recv())

    def save(self, index: int | None = None) -> bytes:
        """Returns the state of environment `index`, or of all, exactly: `restore` continues from there as if
        nothing had been in between, in this process or another, with the same game and settings. It is the
        game's actions since its start, which `restore` plays again: about 15 s for half an hour of play, all
        environments side by side."""
        return pack([self._core.save(i) for i in self._indices(index)])

    def restore(self, state: bytes, index: int | None = None) -> tuple[np.ndarray, dict[str, Any]]:
        """Continues from a state of `save`: of one environment, in environment `index`; or of all of them.
        Returns the observations and infos of all environments as they are then."""
        states, indices = unpack(state), self._indices(index)
        if len(states) != len(indices):
            raise ValueError(f"this state is of {len(states)} environments, not of {len(indices)}")
        if index is not None and not self._started:
            self.reset()
        self._core.restore(dict(zip(indices, states)))
        self._started = True
        observations, arrays = self._arrays()
        self._core.current(arrays.core)
        return observations, self._infos(arrays, np.ones(self.num_envs, np.bool_))

    def render(self) -> tuple[np.ndarray, ...] | None:
        """Returns the games' screens in colour, [rows, 160, 3] each."""
        if self.render_mode is None:
            return None
        return tuple(self._core.screen(i) for i in range(self.num_envs))

    def ram(self) -> np.ndarray:
        """Returns the consoles' memory, [N, 128]."""
        return np.stack([self._core.ram(i) for i in range(self.num_envs)])

    def frame_number(self) -> np.ndarray:
        """Returns how many frames each game has emulated since its ROM was loaded."""
        return np.array([self._core.frame_number(i) for i in range(self.num_envs)])

    def action_meanings(self) -> list[str]:
        """Returns the joystick events of discrete actions; nothing for the continuous joystick."""
        return self._core.events()

    get_action_meanings = action_meanings  # ALE's name, which wrappers look for

    def close_extras(self, **kwargs: Any) -> None:
        """Ends the environments, after the step that is under way."""
        self._finalizer()

    def _indices(self, index: int | None) -> list[int]:
        if index is None:
            return list(range(self.num_envs))
        if not 0 <= index < self.num_envs:
            raise IndexError(f"there is no environment {index}: they are 0 to {self.num_envs - 1}")
        return [index]

    def _reset_options(self, options: dict[str, Any]) -> tuple[np.ndarray, bool]:
        for name in options:
            if name not in _RESET_OPTIONS:
                raise ValueError(f"there is no option {name!r} of reset: they are {', '.join(_RESET_OPTIONS)}")
        mask = options.get("reset_mask")
        if mask is None:
            return np.ones(self.num_envs, np.bool_), bool(options.get("new_game", False))
        if not isinstance(mask, np.ndarray) or mask.dtype != np.bool_ or mask.shape != (self.num_envs,):
            raise ValueError(f"options['reset_mask'] must be an array of {self.num_envs} bool")
        if not mask.any():
            raise ValueError("options['reset_mask'] chooses no environment")
        return np.ascontiguousarray(mask), bool(options.get("new_game", False))

    def _new_arrays(self) -> tuple[np.ndarray, StepArrays]:
        observations = np.empty(self._shape, np.uint8) if self.copy else None
        arrays = StepArrays(self.num_envs, observations, self._frame_skip, *self._has)
        return self._stacks if observations is None else observations, arrays

    def _arrays(self) -> tuple[np.ndarray, StepArrays]:
        """Returns where the next step writes its observations and all else."""
        return self._new_arrays() if self._kept is None else (self._stacks, self._kept)

    def _infos(self, arrays: StepArrays, mask: np.ndarray) -> dict[str, Any]:
        infos = arrays.infos()
        infos.update({f"_{name}": mask.copy() for name in list(infos)})
        return infos

    def _result(self, observations: np.ndarray, arrays: StepArrays) -> tuple[
            np.ndarray, np.ndarray, np.ndarray, np.ndarray, dict[str, Any]]:
        infos = self._infos(arrays, np.ones(self.num_envs, np.bool_))
        if self.autoreset_mode is AutoresetMode.SAME_STEP:
            ended = arrays.terminated | arrays.truncated
            if ended.any():
                self._add_final(infos, ended)
        return observations, arrays.rewards, arrays.terminated, arrays.truncated, infos

    def _add_final(self, infos: dict[str, Any], ended: np.ndarray) -> None:
        """Adds what the last step of each episode that ended showed."""
        final_obs = np.full(self.num_envs, None, dtype=object)
        arrays = StepArrays(self.num_envs, None, self._frame_skip, *self._has)
        for array in arrays.infos().values():
            array.fill(0)
        for i in np.flatnonzero(ended):
            final_obs[i] = np.empty(self._shape[1:], np.uint8)
            self._core.final(int(i), final_obs[i], arrays.core)
        infos.update(final_obs=final_obs, _final_obs=ended.copy(), final_info=self._infos(arrays, ended),
                     _final_info=ended.copy())


def _autoreset_mode(wanted: AutoresetMode | str) -> AutoresetMode:
    for mode in AutoresetMode:
        if wanted in (mode, mode.name, mode.value):
            return mode
    raise ValueError(f"autoreset_mode must be one of NEXT_STEP, SAME_STEP, DISABLED, not {wanted!r}")


@with_settings(apart=("game", "num_envs"))
def make_vec(game: str | Sequence[str], num_envs: int = 1, *, autoreset_mode: AutoresetMode | str = AutoresetMode.NEXT_STEP,
             copy: bool = True, render_mode: str | None = None, **settings: Unpack[Settings]) -> VectorEnv:
    """Returns N environments of a game that step together: see `cale.VectorEnv`.

    game: "breakout", "Breakout" or "ALE/Breakout-v5"; or several, which the environments play in turn:
        ["pong", "breakout"].
    """
    return VectorEnv(game, num_envs, autoreset_mode=autoreset_mode, copy=copy, render_mode=render_mode, **settings)
