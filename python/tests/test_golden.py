"""The traces of the 60 games of the literature, which the C++ library is held to, through Python
(tests/golden/README-environment.md)."""
import csv
import struct
import zlib
from concurrent.futures import ThreadPoolExecutor

import numpy as np

import cale

_SETTINGS = {"actions": "action_space", "threshold": "threshold", "event_map": "event_map",
             "sticky": "sticky_probability", "frame_skip": "frame_skip"}
_MASK = 2**64 - 1


def uniform(seed, i):
    """The i-th number of splitmix64's stream of `seed`."""
    z = (seed + (i + 1) * 0x9E3779B97F4A7C15) & _MASK
    z = ((z ^ (z >> 30)) * 0xBF58476D1CE4E5B9) & _MASK
    z = ((z ^ (z >> 27)) * 0x94D049BB133111EB) & _MASK
    return ((z ^ (z >> 31)) >> 11) * 2.0**-53


def action(env, seed, t):
    if hasattr(env.action_space, "n"):
        return int(uniform(seed, t) * env.action_space.n)
    theta = -np.pi + 2 * np.pi * uniform(seed, 3 * t + 1)
    return np.array([uniform(seed, 3 * t), theta, uniform(seed, 3 * t + 2)], np.float32)


class Trace:
    """The running CRCs of what a game shows."""

    def __init__(self):
        self.frames = self.ram = self.results = 0

    def add(self, env, observation, *numbers):
        self.frames = zlib.crc32(observation[-1], self.frames)
        self.ram = zlib.crc32(env.ram(), self.ram)
        self.results = zlib.crc32(struct.pack(f"<{len(numbers)}i", *numbers), self.results)


def play(case):
    """The CRCs after each block of a case's steps: frames, RAM, results."""
    settings = {ours: case[theirs] for theirs, ours in _SETTINGS.items()}
    env = cale.Env(case["game"], paddle_strength="radius", truncation_is_terminal=True,
                   terminal_on_life_loss=case["life_loss"] == "1",
                   max_frames_per_episode=int(case["max_frames"]) or 10**9, **settings)
    seed, steps, blocks = int(case["action_seed"]), int(case["steps"]), len(case["frames"].split())
    resets = {int(t) for t in case["resets"].split()}
    trace, result = Trace(), []

    def new_game(seed=None):
        observation, info = env.reset(seed=seed, options={"new_game": True})
        trace.add(env, observation, info["lives"], env.frame_number())

    new_game(int(case["ale_seed"]))
    for t in range(steps):
        if t in resets:
            new_game()
        observation, reward, terminated, truncated, info = env.step(action(env, seed, t))
        trace.add(env, observation, info["event"], int(reward), terminated, info["episode_over"], info["frames"],
                  info["lives"], env.frame_number())
        if info["episode_over"] or (terminated and case["reset_on"] == "terminal"):
            new_game()
        elif terminated:
            env.reset()  # the game goes on
        if (t + 1) % (steps // blocks) == 0:
            result.append((trace.frames, trace.ram, trace.results))
    env.close()
    return result


def test_every_trace_is_the_references(repository):
    with open(repository / "tests/golden/environment_all_games.csv", newline="") as file:
        cases = list(csv.DictReader(file))
    assert len({case["game"] for case in cases}) == 60

    def recorded(case):
        return [tuple(int(crc, 16) for crc in block)
                for block in zip(case["frames"].split(), case["ram"].split(), case["results"].split())]

    with ThreadPoolExecutor(2) as pool:
        traces = list(pool.map(play, cases))
    wrong = [f"{case['game']} {case['actions']} seed {case['ale_seed']}"
             for case, trace in zip(cases, traces) if trace != recorded(case)]
    assert not wrong
