"""Dopamine's own JAX agents, from the dopamine-rl package.
     dopamine_peer.py update AGENT ENCODER     ms per gradient step
     dopamine_peer.py run AGENT SECONDS        agent steps per second at the 100k protocol, real ALE
   AGENT: sac, ppo (the CALE ones), dqn, der. Threads: those of the cores that the process may use."""
import atexit
import os
import shutil
import sys
import tempfile
import unittest.mock

os.environ["TF_CPP_MIN_LOG_LEVEL"] = "3"
os.environ["JAX_PLATFORMS"] = "cpu"
sys.path.pop(0)

# Imported by Dopamine at the top of a file; used only by PPO's Gym wrappers and by the DeepMind Control Suite.
for name in "baselines", "baselines.common", "dopamine.labs.sac_from_pixels.deepmind_control_lib":
    sys.modules[name] = unittest.mock.MagicMock()

import jax.interpreters.xla  # noqa: E402
from jax._src import core  # noqa: E402

# TensorFlow Probability 0.25, its last release, asks for this name, which JAX has moved.
jax.interpreters.xla.pytype_aval_mappings = core.pytype_aval_mappings

import gin  # noqa: E402
import numpy as np  # noqa: E402
import tensorflow  # noqa: E402
from dopamine.continuous_domains import run_experiment as continuous  # noqa: E402
from dopamine.discrete_domains import atari_lib  # noqa: E402
from dopamine.discrete_domains import run_experiment as discrete  # noqa: E402
from dopamine.jax.agents.dqn import dqn_agent  # noqa: E402
from dopamine.jax.agents.ppo import ppo_agent  # noqa: E402
from dopamine.labs.atari_100k import atari_100k_rainbow_agent, atari_100k_runner  # noqa: E402
from dopamine.labs.cale import networks, ppo_cale, sac_cale  # noqa: E402

sys.path.insert(0, os.path.dirname(os.path.abspath(__file__)))
from measure import Window, milliseconds, report  # noqa: E402

ACTIONS = 18
LIMITS = np.array([0, -np.pi, 0], np.float32), np.array([1, np.pi, 1], np.float32)
ENCODER = {"phi_sac": "SAC", "phi_dqn": "NatureDQN"}


def make_agent(agent, encoder, observation_shape, actions, capacity=100_000):
    """The agent with the settings of Dopamine's own 100k configuration files."""
    rate, epsilon = (2.5e-4, 1e-5) if agent == "ppo" else (1e-4, 1.5e-4)
    gin.parse_config([
        f"create_optimizer.learning_rate = {rate}", f"create_optimizer.eps = {epsilon}",
        f"ReplayBuffer.batch_size = {1024 if agent == 'ppo' else 32}",
        f"ReplayBuffer.max_capacity = {1024 if agent == 'ppo' else capacity}",
        f"PrioritizedSamplingDistribution.max_capacity = {capacity}"])
    if agent == "sac":
        for name, value in dict(
                reward_scale_factor=0.1, network=networks.SACCALEConvNetwork, num_layers=1, hidden_units=512,
                update_horizon=10, min_replay_history=1600, update_period=1, observation_dtype=np.uint8,
                stack_size=4).items():
            gin.bind_parameter(f"SACAgent.{name}", value)
        gin.bind_parameter("SACCALEConvNetwork.encoder_name", ENCODER[encoder])
        return sac_cale.SACCALEAgent((3,), LIMITS, observation_shape, epsilon_train=0.1,
                                     epsilon_decay_period=5000, exploration_strategy="eps_greedy")
    if agent == "ppo":
        for name, value in dict(
                network=networks.PPOCALEConvNetwork, update_period=1024, num_epochs=3, batch_size=256, epsilon=0.1,
                entropy_coefficient=0.01, stack_size=4).items():
            gin.bind_parameter(f"PPOAgent.{name}", value)
        gin.bind_parameter("PPOCALEConvNetwork.encoder_name", ENCODER[encoder])
        return ppo_cale.PPOCALEAgent((3,), LIMITS, observation_shape, log_action_distributions=False)
    for name, value in dict(update_horizon=10, min_replay_history=1600, update_period=1, target_update_period=2000,
                            epsilon_train=0.01, epsilon_decay_period=2000).items():
        gin.bind_parameter(f"JaxDQNAgent.{name}", value)
    # As released it writes and flushes a summary at every update; here it writes nothing.
    return (dqn_agent.JaxDQNAgent if agent == "dqn" else atari_100k_rainbow_agent.Atari100kRainbowAgent)(
        actions, summary_writer=tensorflow.summary.create_noop_writer())


def fill(agent, continuous, transitions=2000):
    random = np.random.default_rng(1)
    for t in range(transitions):
        frame = random.integers(0, 256, agent.observation_shape, dtype=np.uint8)
        action = random.uniform(*LIMITS).astype(np.float32) if continuous else int(random.integers(ACTIONS))
        agent._store_transition(frame, action, float(random.normal()), t % 500 == 499)


def update(name, encoder):
    # The observation is 84x84, so that phi_dqn is two-dimensional: with the 84x84x1 of its own runner Dopamine
    # convolves it row by row (docs/agents/sac.md), which is a network seven times the size.
    agent = make_agent(name, encoder, (84, 84), ACTIONS)
    if name == "ppo":
        random = np.random.default_rng(1)
        minibatch = [jax.device_put(x) for x in (
            random.integers(0, 256, (256, 84, 84, 4), dtype=np.uint8),
            random.uniform(*LIMITS, size=(256, 3)).astype(np.float32),
            *random.normal(size=(4, 256)).astype(np.float32))]

        def step():
            agent.network_params, agent.optimizer_state, losses = ppo_agent.train_minibatch(
                agent.network_def, agent.network_params, agent.network_optimizer, agent.optimizer_state, *minibatch,
                agent.epsilon, agent.vf_coefficient, agent.entropy_coefficient, agent.clip_critic_loss)
            for value in losses.values():
                value.item()
            jax.block_until_ready(agent.network_params)

        return {"ms": milliseconds(step)}

    fill(agent, continuous=name == "sac")
    agent._sample_from_replay_buffer()
    # From here on the agent's own training step without its replay: the batch stays.
    agent._sample_from_replay_buffer = lambda: None
    agent._replay.update = lambda *_, **__: None

    def step():
        agent._train_step()
        jax.block_until_ready(agent.network_params if name == "sac" else agent.online_params)

    return {"ms": milliseconds(step)}


def run(name, seconds):
    """Dopamine's own runner on ale-py, with a clock in the environment's step."""
    gin.parse_config(["AtariPreprocessing.terminal_on_life_loss = True", "create_atari_environment.game_name = 'Pong'",
                      "create_atari_environment.sticky_actions = False"])
    # Whole rounds of rollout and learning for PPO.
    window, step_environment = Window(seconds, period=1024 if name == "ppo" else 1), atari_lib.AtariPreprocessing.step

    def step(self, action):
        if speed := window.mark(window.steps + 1):
            report(peer="dopamine", agent=name, encoder="phi_sac" if name in ("sac", "ppo") else "phi_dqn",
                   steps_per_second=speed)
            sys.exit()
        return step_environment(self, action)

    atari_lib.AtariPreprocessing.step = step
    sys.stdout = open(os.devnull, "w")
    folder = tempfile.mkdtemp()
    atexit.register(shutil.rmtree, folder)
    if name in ("sac", "ppo"):
        gin.bind_parameter("create_atari_environment.continuous_action_threshold", 0.5)
        continuous.ContinuousTrainRunner(
            folder, lambda env, summary_writer: make_agent(name, "phi_sac", env.observation_space.shape, None),
            atari_lib.create_atari_environment).run_experiment()
    else:
        runner = discrete.TrainRunner if name == "dqn" else atari_100k_runner.DataEfficientAtariRunner
        runner(folder, lambda _, env, summary_writer: make_agent(name, "phi_dqn", None, env.action_space.n),
               create_environment_fn=atari_lib.create_atari_environment).run_experiment()


if __name__ == "__main__":
    kind, name, rest = sys.argv[1:]
    if kind == "update":
        report(peer="dopamine", agent=name, encoder=rest, **update(name, rest))
    else:
        run(name, float(rest))
