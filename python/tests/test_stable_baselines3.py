"""Stable-Baselines3 on our environments, unchanged; and the examples."""
import subprocess
import sys

import numpy as np
import pytest

import cale

pytest.importorskip("torch", reason="no Python torch beside LibTorch (scripts/setup installs one), or a run under sanitizers")
sb3 = pytest.importorskip("stable_baselines3")


@pytest.mark.filterwarnings("ignore:We recommend you to use a symmetric and normalized")
@pytest.mark.parametrize("kind", [{}, {"action_space": "minimal"}, {"joystick": "cartesian"}, {"joystick": "factored"},
                                  {"paddle": "absolute"}, {"obs": "ram"}])
def test_its_checker_passes(kind):
    from stable_baselines3.common.env_checker import check_env

    check_env(cale.Env("breakout", **kind))


def test_its_vector_environment_is_ours():
    """Beside SB3's own DummyVecEnv: observations, rewards, ends, what an episode's last step showed."""
    from stable_baselines3.common.vec_env import DummyVecEnv

    from cale.sb3 import SB3VecEnv

    settings = {"max_frames_per_episode": 200, "terminal_on_life_loss": True}
    ours = SB3VecEnv(cale.make_vec("breakout", num_envs=2, autoreset_mode="SameStep", **settings))
    theirs = DummyVecEnv([lambda: cale.Env("breakout", **settings)] * 2)
    ours.seed(3), theirs.seed(3)
    np.testing.assert_array_equal(ours.reset(), theirs.reset())
    assert ours.metadata["render_fps"] == theirs.metadata["render_fps"] == 15
    ours.step_async(np.stack([ours.action_space.sample()] * 2))
    ours.seed(3), theirs.seed(3)
    np.testing.assert_array_equal(ours.reset(), theirs.reset())  # drops that step
    ends = 0
    for _ in range(150):
        actions = np.array([ours.action_space.sample() for _ in range(2)])
        our_step, their_step = ours.step(actions), theirs.step(actions)
        for mine, other in zip(our_step[:3], their_step[:3]):
            np.testing.assert_array_equal(mine, other)
        for i in np.flatnonzero(our_step[2]):
            ends += 1
            assert our_step[3][i].keys() == their_step[3][i].keys()
            for key in our_step[3][i]:
                np.testing.assert_array_equal(our_step[3][i][key], their_step[3][i][key])
        assert [info["lives"] for info in ours.reset_infos] == [info["lives"] for info in theirs.reset_infos]
    assert ends >= 4
    for both in (ours, theirs):
        both.set_options({"new_game": True})
    np.testing.assert_array_equal(ours.reset(), theirs.reset())
    assert [info["lives"] for info in ours.reset_infos] == [5, 5]
    ours.set_options([{"new_game": True}, {}])
    with pytest.raises(ValueError, match="the environments are reset together"):
        ours.reset()
    ours.set_attr("tag", 5)
    assert ours.get_attr("tag") == [5, 5] and ours.env_method("frame_number", indices=[0, 1])[0].shape == (2,)
    for call in (lambda: ours.set_attr("tag", 6, indices=[0]), lambda: ours.env_method("close", indices=0)):
        with pytest.raises(ValueError, match="these environments are one object; leave indices out"):
            call()
    with pytest.raises(ValueError, match="autoreset_mode='SameStep'"):
        SB3VecEnv(cale.make_vec("pong"))
    with pytest.raises(ValueError, match="copy=True"):
        SB3VecEnv(cale.make_vec("pong", autoreset_mode="SameStep", copy=False))


def test_ppo_learns_freeway():
    """12,288 steps from the console's memory, with a reward for every step up as well: by the game's own, which random
    play does not reach, it depends on luck whether anything is learned. Four seeds have 3.6 to 4.8, at first below 0.6."""
    from stable_baselines3.common.vec_env import VecEnvWrapper, VecMonitor

    from cale.sb3 import SB3VecEnv

    class RewardsHeight(VecEnvWrapper):
        def reset(self):
            observations = self.venv.reset()
            self.height = height_of(observations)
            return observations

        def step_wait(self):
            observations, rewards, dones, infos = self.venv.step_wait()
            height = height_of(observations)
            rewards = rewards + 0.1 * np.sign(height - self.height)
            self.height = height
            return observations, rewards, dones, infos

    def height_of(observations):
        return observations[:, -1, 14].astype(int)

    envs = VecMonitor(SB3VecEnv(cale.make_vec("freeway", num_envs=8, autoreset_mode="SameStep", obs="ram", action_space="minimal",
                                              sticky_probability=0, max_frames_per_episode=2_000)))
    model = sb3.PPO("MlpPolicy", RewardsHeight(envs), seed=1, device="cpu", n_steps=128, batch_size=256, n_epochs=4)
    model.learn(12_288)
    returns = [episode["r"] for episode in model.ep_info_buffer]
    print("returns:", returns)
    assert len(returns) >= 16
    assert np.mean(returns[-8:]) > 2
    envs.close()


@pytest.mark.parametrize(("script", "says", "arguments"), [
    ("sb3_ppo.py", "mean return", ["--steps", "1024", "--num-envs", "2", "--game", "pong"]),
    ("sb3_sac.py", "mean return", ["--steps", "300", "--game", "pong"]),
    ("sac_continuous_action.py", "steps a second", ["--total-timesteps", "600", "--learning-starts", "200",
                                                    "--game", "pong"]),
])
def test_the_examples_run(repository, script, says, arguments):
    ran = subprocess.run([sys.executable, repository / "examples/python" / script, *arguments], capture_output=True,
                         text=True, timeout=300)
    assert ran.returncode == 0, ran.stderr
    assert says in ran.stdout
