"""Stable-Baselines3's own models.
     sb3_peer.py update AGENT ENCODER THREADS   ms per gradient step
     sb3_peer.py run AGENT SECONDS THREADS      agent steps per second at the 100k protocol, real ALE
   AGENT: sac, dqn, ppo. ENCODER: nature (their own, unpadded convolutions) or phi_dqn (padded as ours)."""
import sys

import gymnasium
import numpy as np
import torch
from ale_py.registration import register_v5_envs
from measure import Window, milliseconds, report
from stable_baselines3 import DQN, PPO, SAC
from stable_baselines3.common.atari_wrappers import ClipRewardEnv, EpisodicLifeEnv, MaxAndSkipEnv, WarpFrame
from stable_baselines3.common.callbacks import BaseCallback
from stable_baselines3.common.torch_layers import BaseFeaturesExtractor
from stable_baselines3.common.vec_env import DummyVecEnv, VecFrameStack

ACTIONS = 18


class PhiDqn(BaseFeaturesExtractor):
    """SB3's NatureCNN with the "same" padding of Dopamine and of ours."""

    def __init__(self, space):
        super().__init__(space, 512)
        nn = torch.nn
        self.layers = nn.Sequential(
            nn.Conv2d(4, 32, 8, 4, padding=2), nn.ReLU(),
            nn.ZeroPad2d((1, 2, 1, 2)), nn.Conv2d(32, 64, 4, 2), nn.ReLU(),
            nn.Conv2d(64, 64, 3, 1, padding=1), nn.ReLU(),
            nn.Flatten(), nn.Linear(64 * 11 * 11, 512), nn.ReLU())

    def forward(self, x):
        return self.layers(x)


class Frames(gymnasium.Env):
    """Random frames: an environment for models that only learn here."""

    observation_space = gymnasium.spaces.Box(0, 255, (4, 84, 84), np.uint8)

    def __init__(self, continuous):
        self.action_space = (gymnasium.spaces.Box(np.float32([0, -np.pi, 0]), np.float32([1, np.pi, 1]))
                             if continuous else gymnasium.spaces.Discrete(ACTIONS))

    def reset(self, seed=None, options=None):
        return self.observation_space.sample(), {}

    def step(self, action):
        return self.observation_space.sample(), float(np.random.normal()), np.random.random() < 0.002, False, {}


def make_model(agent, env, policy, capacity=100_000):
    """The 100k settings, in SB3's own terms."""
    off_policy = dict(learning_rate=1e-4, buffer_size=capacity, learning_starts=1600, batch_size=32, train_freq=1,
                      gradient_steps=1)
    if agent == "sac":
        return SAC("CnnPolicy", env, tau=0.005, policy_kwargs=policy | {"net_arch": [512]}, **off_policy)
    if agent == "dqn":
        return DQN("CnnPolicy", env, target_update_interval=2000, policy_kwargs=policy, **off_policy)
    layers = [64, 64] if policy else []  # as ours: two with phi_dqn, none with nature
    return PPO("CnnPolicy", env, n_steps=1024 // env.num_envs, batch_size=256, n_epochs=3, clip_range=0.1,
               ent_coef=0.01, learning_rate=2.5e-4,
               policy_kwargs=policy | {"net_arch": {"pi": layers, "vf": layers}})


def update(agent, encoder):
    env = DummyVecEnv([lambda: Frames(continuous=agent != "dqn")])
    model = make_model(agent, env, {"features_extractor_class": PhiDqn} if encoder == "phi_dqn" else {}, 2000)
    if agent == "ppo":
        # One rollout; the four minibatches of an epoch are timed together.
        model.n_epochs = 1
        _, callback = model._setup_learn(2048)
        callback.on_training_start({}, {})
        model.collect_rollouts(env, callback, model.rollout_buffer, model.n_steps)
        return {"ms": milliseconds(model.train) / 4}
    model.learn(1600)
    batch = model.replay_buffer.sample(32)
    model.replay_buffer.sample = lambda *_, **__: batch
    return {"ms": milliseconds(lambda: model.train(gradient_steps=1, batch_size=32))}


class Clock(BaseCallback):
    """Off-policy models begin a "rollout" at every step, PPO at every 1,024th."""

    def __init__(self, seconds):
        super().__init__()
        self.window = Window(seconds)

    def _on_step(self):
        return True

    def _on_rollout_start(self):
        if speed := self.window.mark(self.num_timesteps):
            report(peer="sb3", agent=agent, encoder="nature", steps_per_second=speed)
            sys.exit()


def run(agent, seconds):
    register_v5_envs()

    def make():
        env = gymnasium.make("ALE/Pong-v5", frameskip=1, repeat_action_probability=0, continuous=agent == "sac",
                             continuous_action_threshold=0.5)
        env = WarpFrame(MaxAndSkipEnv(env, 4))
        # Pong has no lives; EpisodicLifeEnv knows discrete actions only.
        return env if agent == "sac" else ClipRewardEnv(EpisodicLifeEnv(env))

    env = VecFrameStack(DummyVecEnv([make] * (8 if agent == "ppo" else 1)), 4)
    make_model(agent, env, {}).learn(100_000, callback=Clock(seconds))


if __name__ == "__main__":
    kind, agent, rest, threads = sys.argv[1:]
    torch.set_num_threads(int(threads))
    if kind == "update":
        report(peer="sb3", agent=agent, encoder=rest, **update(agent, rest))
    else:
        run(agent, float(rest))
