#!/usr/bin/env python3
"""Makes tests/golden/environment_all_games.csv from ale-py and OpenCV: the environment of all 60 games.

Run by hand, where the reference or the cases change; the tests only read the file. It needs

    python3 -m venv FOLDER
    FOLDER/bin/pip install ale-py==0.12.1 opencv-python-headless numpy
    FOLDER/bin/python scripts/golden/environment.py

With --random N --seed S it writes N cases per game with settings drawn at random, to be compared once:

    FOLDER/bin/python scripts/golden/environment.py --random 4 --seed 7 --output /tmp/cases/environment_all_games.csv
    CALE_GOLDEN_DIR=/tmp/cases build/bin/test_cale --gtest_filter='*GoldenGames*'

The file and the environment are described in tests/golden/README-environment.md.
"""

import argparse
import csv
import math
import pathlib
import random
import re
import struct
import zlib

import ale_py
import cv2
import numpy as np
from ale_py import roms

ROOT = pathlib.Path(__file__).resolve().parents[2]
BLOCKS = 6
COLUMNS = ["game", "actions", "threshold", "event_map", "sticky", "life_loss", "reset_on", "resets", "frame_skip",
           "max_frames", "ale_seed", "action_seed", "steps", "frames", "ram", "results"]


def games():
    """The ROMs' names."""
    with open(ROOT / "data/reference_scores.csv") as file:
        names = [row["game"] for row in csv.DictReader(file) if row["cale60"] == "1"]
    assert len(names) == 60
    return [re.sub("(?<!^)(?=[A-Z])", "_", name).lower() for name in names]


def uniform(seed, index):
    """splitmix64 by index, in [0, 1)."""
    mask = 2**64 - 1
    z = (seed + (index + 1) * 0x9E3779B97F4A7C15) & mask
    z = ((z ^ (z >> 30)) * 0xBF58476D1CE4E5B9) & mask
    z = ((z ^ (z >> 27)) * 0x94D049BB133111EB) & mask
    return ((z ^ (z >> 31)) >> 11) * 2.0**-53


def joystick_event(r, theta, fire, threshold, event_map):
    """The event's number in ale::Action. ALE 0.10 to 0.11 compared with +tau on both sides."""
    tau = np.float32(threshold)
    low = tau if event_map == "ale_0_10" else -tau
    x, y = r * np.cos(theta), r * np.sin(theta)
    across = int(x > tau) - int(x < low)
    upwards = int(y > tau) - int(y < low)
    base = {(0, 0): 0, (0, 1): 2, (1, 0): 3, (-1, 0): 4, (0, -1): 5,
            (1, 1): 6, (-1, 1): 7, (1, -1): 8, (-1, -1): 9}[across, upwards]
    if not fire > tau:
        return base
    return base + 8 if base else 1


class Environment:
    """Dopamine's AtariPreprocessing on ALE; needs a frame_skip of 2 or more."""

    def __init__(self, case):
        self.case = case
        self.ale = ale_py.ALEInterface()
        self.ale.setInt("random_seed", case["ale_seed"])
        self.ale.setFloat("repeat_action_probability", case["sticky"])
        self.ale.setInt("frame_skip", 1)
        self.ale.setBool("color_averaging", False)
        self.ale.setInt("max_num_frames_per_episode", case["max_frames"])
        self.ale.loadROM(roms.get_rom_path(case["game"]))
        self.actions = {"continuous": None, "minimal": self.ale.getMinimalActionSet(),
                        "full": self.ale.getLegalActionSet()}[case["actions"]]

    def reset(self):
        self.ale.reset_game()
        self.lives = self.ale.lives()
        self.buffers = [self.ale.getScreenGrayscale(), np.zeros_like(self.ale.getScreenGrayscale())]
        return self.observe()

    def observe(self):
        np.maximum(self.buffers[0], self.buffers[1], out=self.buffers[0])
        return cv2.resize(self.buffers[0], (84, 84), interpolation=cv2.INTER_AREA)

    def action(self, t):
        """Event and strength of agent step t."""
        seed = self.case["action_seed"]
        if self.actions is not None:
            return self.actions[int(uniform(seed, t) * len(self.actions))].value, 1.0
        r = np.float32(uniform(seed, 3 * t))
        theta = np.float32(-math.pi + 2 * math.pi * uniform(seed, 3 * t + 1))
        fire = np.float32(uniform(seed, 3 * t + 2))
        return joystick_event(r, theta, fire, self.case["threshold"], self.case["event_map"]), float(r)

    def step(self, event, strength):
        """Observation, reward, terminal, game over, frames."""
        skip = self.case["frame_skip"]
        reward = 0
        for frame in range(skip):
            reward += self.ale.act(ale_py.Action(event), strength)
            game_over = terminal = self.ale.game_over()
            if self.case["life_loss"]:
                lives = self.ale.lives()
                terminal = game_over or lives < self.lives
                self.lives = lives
            if frame >= skip - 2:
                self.buffers[frame - (skip - 2)] = self.ale.getScreenGrayscale()
            if terminal:
                break
        return self.observe(), reward, terminal, game_over, frame + 1


def play(case):
    """Running CRCs of the observations, the RAM and the results, BLOCKS of each."""
    env = Environment(case)
    crcs = [0, 0, 0]
    blocks = ([], [], [])
    resets = [int(step) for step in case["resets"].split()]

    def add(observation, *results):
        parts = observation.tobytes(), env.ale.getRAM().tobytes(), struct.pack(f"<{len(results)}i", *results)
        for which, part in enumerate(parts):
            crcs[which] = zlib.crc32(part, crcs[which])

    def reset():
        add(env.reset(), env.ale.lives(), env.ale.getFrameNumber())

    reset()
    for t in range(case["steps"]):
        if t in resets:
            reset()
        event, strength = env.action(t)
        observation, reward, terminal, game_over, frames = env.step(event, strength)
        add(observation, event, reward, terminal, game_over, frames, env.ale.lives(), env.ale.getFrameNumber())
        if game_over or (terminal and case["reset_on"] == "terminal"):
            reset()
        if (t + 1) % (case["steps"] // BLOCKS) == 0:
            for block, crc in zip(blocks, crcs):
                block.append(f"{crc:08x}")
    return [" ".join(block) for block in blocks]


def standing_cases(number, game):
    """Sticky actions and life loss, each on and off, with all three action sets, three resets in each."""
    threshold = (0.5, 0.1, 0.9)[number % 3]
    for index, (sticky, life_loss, actions) in enumerate(
            [(0.25, False, "continuous"), (0.25, True, "minimal"), (0.0, False, "full"), (0.0, True, "continuous")]):
        seed = 10 * number + index + 1
        yield {"game": game, "actions": actions, "threshold": threshold, "event_map": "symmetric", "sticky": sticky,
               "life_loss": life_loss, "reset_on": "game_over", "resets": "15 35", "frame_skip": 4, "max_frames": 0,
               "ale_seed": seed, "action_seed": 1000 + seed, "steps": 120}


def random_case(draw, game, most_steps):
    steps = BLOCKS * draw.randint(10, most_steps // BLOCKS)
    # DER's and Dopamine's frame skip is 4; a limit on the frames cuts games off in the middle of a step, too.
    return {"game": game, "actions": draw.choice(["continuous", "continuous", "minimal", "full"]),
            "threshold": draw.choice([0.0, 0.1, 0.25, 0.3, 0.5, 0.5, 0.7, 0.75, 0.9, round(draw.random(), 3)]),
            "event_map": draw.choice(["symmetric", "symmetric", "ale_0_10"]),
            "sticky": draw.choice([0.0, 0.25, 0.25, 0.5, round(0.7 * draw.random(), 3)]),
            "life_loss": draw.random() < 0.5, "reset_on": draw.choice(["game_over", "terminal"]),
            "resets": " ".join(str(draw.randrange(steps)) for _ in range(draw.randint(0, 3))),
            "frame_skip": draw.choice([4, 4, 4, 2, 3, 5, 8]), "max_frames": draw.choice([0, 0, draw.randint(300, 3000)]),
            "ale_seed": draw.randrange(2**31), "action_seed": draw.randrange(2**64), "steps": steps}


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--output", type=pathlib.Path, default=ROOT / "tests/golden/environment_all_games.csv")
    parser.add_argument("--random", type=int, metavar="N", help="N random cases per game")
    parser.add_argument("--seed", type=int, default=1, help="of the random cases")
    parser.add_argument("--steps", type=int, default=600, help="at most, of a random case")
    arguments = parser.parse_args()

    ale_py.ALEInterface.setLoggerMode(ale_py.LoggerMode.Error)
    draw = random.Random(arguments.seed)
    with open(arguments.output, "w", newline="") as file:
        table = csv.DictWriter(file, COLUMNS, lineterminator="\n")
        table.writeheader()
        for number, game in enumerate(games()):
            cases = ([random_case(draw, game, arguments.steps) for _ in range(arguments.random)]
                     if arguments.random else standing_cases(number, game))
            for case in cases:
                frames, ram, results = play(case)
                table.writerow(case | {"life_loss": int(case["life_loss"]), "frames": frames, "ram": ram,
                                       "results": results})


if __name__ == "__main__":
    main()
