"""Seeds of games."""

from __future__ import annotations

import secrets

import numpy as np

_LARGEST = 2**31 - 1  # ALE takes no larger ones


def game_seed(seed: int) -> int:
    """Returns the seed of a game: the same number, or for a larger one 31 bits that follow from it."""
    if seed < 0:
        raise ValueError(f"seed is {seed}: it must be 0 or more")
    if seed <= _LARGEST:
        return seed
    return int(np.random.SeedSequence(seed).generate_state(1)[0]) & _LARGEST


def random_seeds(count: int) -> list[int]:
    """Returns so many seeds that nobody knows beforehand."""
    return [secrets.randbelow(_LARGEST + 1) for _ in range(count)]
