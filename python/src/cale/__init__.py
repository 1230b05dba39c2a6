"""The Continuous Arcade Learning Environment for Python: Atari 2600 games with a continuous joystick.

    import cale

    envs = cale.make_vec("breakout", num_envs=8)
    observations, infos = envs.reset(seed=1)
    observations, rewards, terminated, truncated, infos = envs.step(envs.action_space.sample())

`cale.make_vec` makes N environments that step together, `cale.Env` one. Both take every setting of the
environment by name: `cale.settings()` lists them. `cale.Policy` acts by a trained policy, and `cale.evaluate`
plays games with it. Importing cale registers "cale/Breakout-v0" and the other games with Gymnasium.
"""

from importlib.metadata import version as _version

from cale._env import Env
from cale._policy import Evaluation, Policy, evaluate
from cale._registration import game_ids, register
from cale._settings import games, settings
from cale._vector_env import VectorEnv, make_vec

__version__ = _version("cale")
__all__ = ["Env", "Evaluation", "Policy", "VectorEnv", "evaluate", "game_ids", "games", "make_vec", "settings"]

register()
