"""Soft actor-critic in one file, in the style of CleanRL, on the continuous joystick of a vector environment of cale's.

    python3 -m venv env && env/bin/pip install ./python torch
    env/bin/python examples/python/sac_continuous_action.py --game road_runner --total-timesteps 100000

The agent sees the console's memory. Equations: Haarnoja et al. 2018, "Soft Actor-Critic Algorithms and Applications".
"""
import argparse
import random
import time

import gymnasium as gym
import numpy as np
import torch
import torch.nn.functional as F
from torch import nn, optim

import cale


def parse_args():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--game", default="road_runner")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--num-envs", type=int, default=4)
    parser.add_argument("--total-timesteps", type=int, default=100_000, help="agent steps of all environments together")
    parser.add_argument("--learning-starts", type=int, default=2_000)
    parser.add_argument("--buffer-size", type=int, default=100_000)
    parser.add_argument("--batch-size", type=int, default=64)
    parser.add_argument("--gamma", type=float, default=0.99)
    parser.add_argument("--tau", type=float, default=0.005)
    parser.add_argument("--policy-lr", type=float, default=3e-4)
    parser.add_argument("--q-lr", type=float, default=1e-3)
    return parser.parse_args()


class ReplayBuffer:
    """Transitions of all environments, the newest `size` of them."""

    def __init__(self, size, observation_space, action_space):
        self.obs = np.zeros((size, *observation_space.shape), observation_space.dtype)
        self.next_obs = np.zeros_like(self.obs)
        self.actions = np.zeros((size, *action_space.shape), np.float32)
        self.rewards, self.terminated = np.zeros(size, np.float32), np.zeros(size, np.float32)
        self.size, self.added = size, 0

    def add(self, obs, next_obs, actions, rewards, terminated):
        rows = np.arange(self.added, self.added + len(rewards)) % self.size
        self.obs[rows], self.next_obs[rows], self.actions[rows] = obs, next_obs, actions
        self.rewards[rows], self.terminated[rows] = rewards, terminated
        self.added += len(rewards)

    def sample(self, batch_size):
        rows = np.random.randint(0, min(self.added, self.size), batch_size)
        return [torch.from_numpy(array[rows]) for array in
                (self.obs, self.next_obs, self.actions, self.rewards, self.terminated)]


def features(obs):
    """Bytes of memory as numbers around 0."""
    return obs.flatten(1).float() / 127.5 - 1


class SoftQNetwork(nn.Module):
    def __init__(self, envs):
        super().__init__()
        inputs = np.prod(envs.single_observation_space.shape) + np.prod(envs.single_action_space.shape)
        self.layers = nn.Sequential(nn.Linear(inputs, 256), nn.ReLU(), nn.Linear(256, 256), nn.ReLU(), nn.Linear(256, 1))

    def forward(self, obs, action):
        return self.layers(torch.cat([features(obs), action], 1)).view(-1)


class Actor(nn.Module):
    def __init__(self, envs):
        super().__init__()
        inputs, actions = np.prod(envs.single_observation_space.shape), np.prod(envs.single_action_space.shape)
        self.trunk = nn.Sequential(nn.Linear(inputs, 256), nn.ReLU(), nn.Linear(256, 256), nn.ReLU())
        self.mean, self.log_std = nn.Linear(256, actions), nn.Linear(256, actions)
        low, high = torch.tensor(envs.single_action_space.low), torch.tensor(envs.single_action_space.high)
        self.register_buffer("scale", (high - low) / 2)
        self.register_buffer("bias", (high + low) / 2)

    def get_action(self, obs):
        """An action and its log-density."""
        x = self.trunk(features(obs))
        mean, log_std = self.mean(x), -5 + 3.5 * (torch.tanh(self.log_std(x)) + 1)  # -5 to 2
        normal = torch.distributions.Normal(mean, log_std.exp())
        u = normal.rsample()
        squashed = torch.tanh(u)
        log_prob = (normal.log_prob(u) - torch.log(self.scale * (1 - squashed.pow(2)) + 1e-6)).sum(1)
        return squashed * self.scale + self.bias, log_prob


def main():
    args = parse_args()
    random.seed(args.seed)
    np.random.seed(args.seed)
    torch.manual_seed(args.seed)

    envs = cale.make_vec(args.game, num_envs=args.num_envs, autoreset_mode=gym.vector.AutoresetMode.SAME_STEP,
                         obs="ram", frame_stack=2, joystick="cartesian", sticky_probability=0,
                         terminal_on_life_loss=True)
    envs = gym.wrappers.vector.RecordEpisodeStatistics(envs)
    actor = Actor(envs)
    qf1, qf2, qf1_target, qf2_target = (SoftQNetwork(envs) for _ in range(4))
    qf1_target.load_state_dict(qf1.state_dict())
    qf2_target.load_state_dict(qf2.state_dict())
    q_optimizer = optim.Adam([*qf1.parameters(), *qf2.parameters()], lr=args.q_lr)
    actor_optimizer = optim.Adam(actor.parameters(), lr=args.policy_lr)
    target_entropy = -float(np.prod(envs.single_action_space.shape))
    log_alpha = torch.zeros(1, requires_grad=True)
    alpha_optimizer = optim.Adam([log_alpha], lr=args.q_lr)
    buffer = ReplayBuffer(args.buffer_size, envs.single_observation_space, envs.single_action_space)

    start_time, returns = time.time(), []
    obs, _ = envs.reset(seed=args.seed)
    envs.action_space.seed(args.seed)
    for global_step in range(0, args.total_timesteps, args.num_envs):
        if global_step < args.learning_starts:
            actions = envs.action_space.sample()
        else:
            with torch.no_grad():
                actions = actor.get_action(torch.from_numpy(obs))[0].numpy()
        next_obs, rewards, terminated, truncated, infos = envs.step(actions)

        real_next_obs = next_obs.copy()
        for i in np.flatnonzero(terminated | truncated):
            real_next_obs[i] = infos["final_obs"][i]
        if "episode" in infos:
            returns += list(infos["episode"]["r"][infos["_episode"]])
        buffer.add(obs, real_next_obs, actions, np.sign(rewards), terminated)
        obs = next_obs

        if global_step < args.learning_starts:
            continue
        for _ in range(args.num_envs):
            b_obs, b_next_obs, b_actions, b_rewards, b_terminated = buffer.sample(args.batch_size)
            alpha = log_alpha.exp().detach()
            with torch.no_grad():
                next_actions, next_log_prob = actor.get_action(b_next_obs)
                next_q = torch.min(qf1_target(b_next_obs, next_actions), qf2_target(b_next_obs, next_actions))
                target = b_rewards + (1 - b_terminated) * args.gamma * (next_q - alpha * next_log_prob)
            q_loss = F.mse_loss(qf1(b_obs, b_actions), target) + F.mse_loss(qf2(b_obs, b_actions), target)
            q_optimizer.zero_grad()
            q_loss.backward()
            q_optimizer.step()

            pi, log_prob = actor.get_action(b_obs)
            actor_loss = (alpha * log_prob - torch.min(qf1(b_obs, pi), qf2(b_obs, pi))).mean()
            actor_optimizer.zero_grad()
            actor_loss.backward()
            actor_optimizer.step()

            alpha_loss = -(log_alpha.exp() * (log_prob.detach() + target_entropy)).mean()
            alpha_optimizer.zero_grad()
            alpha_loss.backward()
            alpha_optimizer.step()

            for net, target_net in ((qf1, qf1_target), (qf2, qf2_target)):
                for parameter, target_parameter in zip(net.parameters(), target_net.parameters()):
                    target_parameter.data.lerp_(parameter.data, args.tau)

        if global_step % 10_000 < args.num_envs:
            print(f"step {global_step}: mean return of the newest episodes {np.mean(returns[-20:] or [0]):.1f}")

    speed = args.total_timesteps / (time.time() - start_time)
    print(f"{len(returns)} episodes, mean return of the newest 20: {np.mean(returns[-20:] or [0]):.1f}, "
          f"{speed:.0f} steps a second")
    envs.close()


if __name__ == "__main__":
    main()
