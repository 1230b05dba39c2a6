"""Stable-Baselines3's PPO on a vector environment of cale's, unchanged.

    python3 -m venv env && env/bin/pip install ./python stable-baselines3
    env/bin/python examples/python/sb3_ppo.py --game breakout --steps 1000000

Says the mean return of the newest hundred episodes at the end.
"""
import argparse

from stable_baselines3 import PPO
from stable_baselines3.common.vec_env import VecMonitor

import cale
from cale.sb3 import SB3VecEnv


def train(game="breakout", steps=100_000, num_envs=8, seed=1, obs="pixels", action_space="continuous", **ppo):
    """Returns the model and the returns of its newest hundred episodes."""
    envs = cale.make_vec(game, num_envs=num_envs, autoreset_mode="SameStep", obs=obs, action_space=action_space,
                         sticky_probability=0, terminal_on_life_loss=True)
    settings = {"n_steps": 128, "batch_size": 256, "n_epochs": 4, "learning_rate": 2.5e-4, "clip_range": 0.1,
                "ent_coef": 0.01, **ppo}
    policy = "CnnPolicy" if obs == "pixels" else "MlpPolicy"
    model = PPO(policy, VecMonitor(SB3VecEnv(envs)), seed=seed, device="cpu", **settings)
    model.learn(steps)
    returns = [episode["r"] for episode in model.ep_info_buffer]
    envs.close()
    return model, returns


if __name__ == "__main__":
    arguments = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    arguments.add_argument("--game", default="breakout")
    arguments.add_argument("--steps", type=int, default=100_000, help="agent steps of all environments together")
    arguments.add_argument("--num-envs", type=int, default=8)
    arguments.add_argument("--seed", type=int, default=1)
    arguments.add_argument("--obs", choices=["pixels", "ram"], default="pixels")
    arguments.add_argument("--action-space", choices=["continuous", "minimal", "full"], default="continuous")
    _, last = train(**vars(arguments.parse_args()))
    print(f"{len(last)} episodes, mean return {sum(last) / max(len(last), 1):.2f}")
