"""Stable-Baselines3's SAC on the continuous joystick, unchanged, from the console's memory.

    python3 -m venv env && env/bin/pip install ./python stable-baselines3
    env/bin/python examples/python/sb3_sac.py --game road_runner --steps 100000

Says the mean return of the newest hundred episodes at the end.
"""
import argparse

from stable_baselines3 import SAC
from stable_baselines3.common.vec_env import VecMonitor

import cale
from cale.sb3 import SB3VecEnv


def train(game="road_runner", steps=100_000, num_envs=4, seed=1):
    """Returns the model and the returns of its newest hundred episodes."""
    # Cartesian coordinates: a Gaussian in (r, theta) has a seam where theta is pi and -pi.
    envs = cale.make_vec(game, num_envs=num_envs, autoreset_mode="SameStep", obs="ram", frame_stack=2,
                         joystick="cartesian", sticky_probability=0, terminal_on_life_loss=True)
    model = SAC("MlpPolicy", VecMonitor(SB3VecEnv(envs)), seed=seed, device="cpu", buffer_size=max(steps, 1000),
                learning_starts=min(2000, steps // 2), gradient_steps=num_envs, batch_size=64)
    model.learn(steps)
    returns = [episode["r"] for episode in model.ep_info_buffer]
    envs.close()
    return model, returns


if __name__ == "__main__":
    arguments = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    arguments.add_argument("--game", default="road_runner")
    arguments.add_argument("--steps", type=int, default=100_000, help="agent steps of all environments together")
    arguments.add_argument("--num-envs", type=int, default=4)
    arguments.add_argument("--seed", type=int, default=1)
    _, last = train(**vars(arguments.parse_args()))
    print(f"{len(last)} episodes, mean return {sum(last) / max(len(last), 1):.2f}")
