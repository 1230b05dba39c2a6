"""Agent steps per second of ale-py's AtariVectorEnv under the same actions: one number on stdout.
   peer_env.py GAME ENVIRONMENTS THREADS STEPS"""
import sys
import time

import numpy as np
from ale_py.vector_env import AtariVectorEnv

game, num_envs, threads, steps = sys.argv[1], *map(int, sys.argv[2:5])
env = AtariVectorEnv(game=game, num_envs=num_envs, num_threads=threads, continuous=True,
                     continuous_action_threshold=0.5, repeat_action_probability=0.25, frameskip=4,
                     stack_num=4, img_height=84, img_width=84, grayscale=True, maxpool=True, noop_max=0,
                     use_fire_reset=False, episodic_life=False, reward_clipping=False)
env.reset(seed=0)
random = np.random.default_rng(1)
low, high = np.array([0, -np.pi, 0]), np.array([1, np.pi, 1])
actions = random.uniform(low, high, size=(100 + steps // num_envs, num_envs, 3)).astype(np.float32)
for i, action in enumerate(actions):
    if i == 100:
        start = time.perf_counter()
    env.step(action)
print(f"{steps // num_envs * num_envs / (time.perf_counter() - start):.1f}")
