"""Gymnasium's own checks, and our vector environments beside Gymnasium's of the same games."""
import gymnasium
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env
from gymnasium.vector import AutoresetMode, SyncVectorEnv

import cale

KINDS = [
    {},
    {"action_space": "minimal"},
    {"action_space": "full"},
    {"joystick": "cartesian"},
    {"joystick": "direction"},
    {"joystick": "factored"},
    {"paddle": "absolute"},
    {"obs": "ram", "frame_stack": 2},
    {"stick_speed": 0.2, "action_latency": (0, 8), "observation_latency": 3},
    {"terminal_on_life_loss": True, "sticky_probability": 0},
]


def name(kind):
    return "-".join(f"{key}={value}" for key, value in kind.items()) or "default"


@pytest.mark.filterwarnings("ignore:.*For Box action spaces, we recommend.*", "ignore:.*is not within.*210.*")
@pytest.mark.parametrize("kind", KINDS, ids=name)
def test_gymnasiums_checker_passes(kind):
    check_env(cale.Env("breakout", render_mode="rgb_array", **kind))


def test_a_seed_of_numpys_is_a_seed():
    first, second = cale.Env("breakout"), cale.Env("breakout")
    np.testing.assert_array_equal(first.reset(seed=5)[0], second.reset(seed=np.int64(5))[0])


def test_all_games_are_registered():
    assert "cale/Breakout-v0" in cale.game_ids() and len(cale.game_ids()) == 64
    assert all(name in gymnasium.registry for name in cale.game_ids())
    env = gymnasium.make("cale/MsPacman-v0", action_space="minimal")
    assert env.action_space.n == 9 and env.unwrapped.spec.id == "cale/MsPacman-v0"
    for mode in (None, "sync"):
        envs = gymnasium.make_vec("cale/Pong-v0", num_envs=2, vectorization_mode=mode, obs="ram")
        assert isinstance(envs.unwrapped, cale.VectorEnv if mode is None else SyncVectorEnv)
        assert envs.reset(seed=1)[0].shape == (2, 4, 128)
        envs.close()


def same_infos(ours, theirs, everything=True):
    """Whether the infos of the environments that have them are equal."""
    assert not everything or ours.keys() == theirs.keys()
    for key, values in theirs.items():
        if key.startswith("_"):
            np.testing.assert_array_equal(ours[key], values, err_msg=key)
        elif isinstance(values, dict):
            same_infos(ours[key], values)
        else:
            has = theirs[f"_{key}"]
            assert len(ours[key]) == len(values)
            for i in np.flatnonzero(has):
                np.testing.assert_array_equal(ours[key][i], values[i], err_msg=key)
    return True


@pytest.mark.parametrize("mode", list(AutoresetMode))
@pytest.mark.parametrize("kind", KINDS, ids=name)
def test_a_vector_environment_is_gymnasiums_of_single_ones(kind, mode):
    """Bit for bit: observations, rewards, ends, infos and their masks, with games that end all the time."""
    settings = {"max_frames_per_episode": 300, "noop_max": 5, **kind}
    ours = cale.make_vec("breakout", num_envs=3, autoreset_mode=mode, **settings)
    theirs = SyncVectorEnv([lambda: cale.Env("breakout", **settings)] * 3, autoreset_mode=mode)
    assert ours.metadata["autoreset_mode"] is mode
    assert ours.action_space == theirs.action_space and ours.observation_space == theirs.observation_space
    assert ours.single_action_space == theirs.single_action_space
    ours.action_space.seed(7)
    (our_obs, our_infos), (their_obs, their_infos) = ours.reset(seed=11), theirs.reset(seed=11)
    np.testing.assert_array_equal(our_obs, their_obs)
    assert same_infos(our_infos, their_infos)
    ends = 0
    for _ in range(160):
        actions = ours.action_space.sample()
        our_step, their_step = ours.step(actions), theirs.step(actions)
        for mine, other in zip(our_step[:4], their_step[:4]):
            np.testing.assert_array_equal(mine, other)
            assert mine.dtype == other.dtype
        assert same_infos(our_step[4], their_step[4])
        ended = our_step[2] | our_step[3]
        ends += ended.sum()
        if mode is AutoresetMode.DISABLED and ended.any():
            (our_obs, our_infos), (their_obs, their_infos) = (
                envs.reset(options={"reset_mask": ended.copy()}) for envs in (ours, theirs))
            np.testing.assert_array_equal(our_obs, their_obs)
            assert same_infos(our_infos, their_infos)
    assert ends >= 6
    ours.close(), theirs.close()


def test_wrappers_of_gymnasium_work():
    envs = cale.make_vec("pong", num_envs=2, max_frames_per_episode=200)
    envs = gymnasium.wrappers.vector.RecordEpisodeStatistics(gymnasium.wrappers.vector.ClipReward(envs, -1, 1))
    envs.reset(seed=1)
    lengths = []
    for _ in range(120):
        infos = envs.step(envs.action_space.sample())[4]
        lengths += list(infos["episode"]["l"][infos["_episode"]]) if "episode" in infos else []
    assert lengths == [50] * 4
    listed = gymnasium.wrappers.vector.DictInfoToList(cale.make_vec("pong", num_envs=2))
    _, infos = listed.reset(seed=1)
    assert len(infos) == 2 and infos[1]["lives"] == 0


def test_the_meanings_of_actions_are_known_before_the_first_reset():
    assert cale.Env("pong", action_space="minimal").action_meanings()[:2] == ["NOOP", "FIRE"]
    assert cale.Env("pong").action_meanings() == []
