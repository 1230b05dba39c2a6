"""The games in Gymnasium's registry."""

from __future__ import annotations

import gymnasium

from cale import _core


def game_ids() -> list[str]:
    """Returns the ids of the games: "cale/Breakout-v0" and the others."""
    return [f"cale/{game['name']}-v0" for game in _core.games()]


def register() -> None:
    """Registers the games with Gymnasium, for `gymnasium.make` and `gymnasium.make_vec`. Importing cale does."""
    for game, name in zip(_core.games(), game_ids()):
        if name not in gymnasium.registry:
            gymnasium.register(name, entry_point="cale:Env", vector_entry_point="cale:VectorEnv",
                               kwargs={"game": game["rom"]})
