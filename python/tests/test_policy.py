"""Trained policies, held to what the C++ tools do with them."""
import csv
import os
import signal
import warnings

import numpy as np
import pytest

import cale
from cale._settings import texts_of


def recorded(repository, name, games):
    """The first games of `cale evaluate policies/NAME.safetensors`: return, length, frames of each."""
    with open(repository / f"policies/{name}.csv", newline="") as file:
        rows = list(csv.DictReader(file))[:games]
    return [(float(row["return"]), int(row["length"]), int(row["frames"])) for row in rows]


@pytest.mark.parametrize("name", ["road_runner_sac", "road_runner_joystick", "kung_fu_master_sac", "boxing_sac"])
def test_games_are_those_of_the_tool(repository, name):
    """`cale evaluate` computes with LibTorch and recorded these games; the same games here have the same returns."""
    played = cale.evaluate(repository / f"policies/{name}.safetensors", games=3)
    assert list(zip(played.returns, played.lengths, played.frames)) == recorded(repository, name, 3)


def test_a_policy_acts_on_numpys_observations(repository):
    policy = cale.Policy(repository / "policies/road_runner_sac.safetensors")
    assert policy.info["game"] == "RoadRunner" and policy.info["observation_shape"] == (2, 128)
    envs = policy.make_vec(num_envs=3)
    observations, _ = envs.reset(seed=1)
    returns = np.zeros(3)
    for _ in range(200):
        actions = policy.act(observations)
        assert actions.dtype == np.float32 and envs.action_space.contains(actions)
        np.testing.assert_array_equal(actions[1], policy.act(observations[1]))
        observations, rewards, *_ = envs.step(actions)
        returns += rewards
    assert returns.mean() > 500
    assert policy.output(observations).shape == (3, 6)
    with pytest.raises(TypeError, match="know no action values"):
        policy.values(observations)


def test_the_joystick_is_that_which_act_writes(repository):
    policy = cale.Policy(repository / "policies/road_runner_sac.safetensors")  # trained on cartesian coordinates
    assert policy.settings["joystick"] == "polar"
    assert policy.make_vec(joystick="polar").single_action_space.shape == (3,)
    for make in (policy.make_vec, policy.make_env):
        with pytest.raises(ValueError, match="joystick=cartesian: this policy's act.. writes polar coordinates"):
            make(joystick="cartesian")
        with pytest.raises(ValueError, match="cannot play there: it sees other observations"):
            make(frame_stack=4)
        with pytest.raises(ValueError, match="cannot play there: it was trained with action_space=continuous"):
            make(action_space="full")
        with pytest.raises(FileNotFoundError, match="road_runner.bin is not in /nowhere"):
            make(rom_dir="/nowhere").reset()
    assert policy.make_vec(num_envs=2, copy=False, autoreset_mode="SAME_STEP", render_mode="rgb_array").num_envs == 2
    with pytest.raises(ValueError, match="cannot play there: it was trained with joystick=cartesian; leave joystick out"):
        cale.evaluate(policy, games=1, joystick="direction")


def test_a_policy_draws_what_its_seed_says(repository):
    file = repository / "policies/road_runner_sac.safetensors"
    observations, _ = cale.Policy(file).make_vec(num_envs=2).reset(seed=1)
    a, b, c = (cale.Policy(file, seed=seed).act(observations, "sampled") for seed in (1, 1, 2))
    np.testing.assert_array_equal(a, b)
    assert not np.array_equal(a, c)
    assert not np.array_equal(a, cale.Policy(file).act(observations))


def test_a_noisy_policy_of_categories(repository):
    """Rainbow on the joystick: action values, noise in its weights, an action in three parts."""
    policy = cale.Policy(repository / "policies/kung_fu_master_rainbow.safetensors")
    envs = policy.make_vec(num_envs=2)
    observations, _ = envs.reset(seed=1)
    for _ in range(30):
        actions = policy.act(observations, "as_evaluated")
        assert envs.action_space.contains(actions)
        observations, *_ = envs.step(actions)
    np.testing.assert_array_equal(policy.values(observations), policy.output(observations).max(axis=1))
    draws = {policy.act(observations, "as_evaluated").tobytes() for _ in range(50)}
    greedy = {policy.act(observations).tobytes() for _ in range(50)}
    assert len(draws) > 1 and len(greedy) == 1
    numbers = policy.output(observations).argmax(axis=1)
    np.testing.assert_array_equal(policy.act(observations), np.stack([numbers // 6, numbers // 2 % 3, numbers % 2], axis=1))


def test_evaluations_repeat_whatever_the_threads(repository):
    file = repository / "policies/road_runner_joystick.safetensors"
    one, two = (cale.evaluate(file, games=2, seed=5, threads=threads) for threads in (1, 2))
    np.testing.assert_array_equal(one.returns, two.returns)
    assert one == two
    assert one.mean == one.returns.mean()
    other = cale.evaluate(file, games=2, seed=5, sticky_probability=0.25)
    assert not np.array_equal(one.lengths, other.lengths)
    assert one != other


def test_evaluations_choose_as_the_training_s_did_unless_told_otherwise(repository):
    file = repository / "policies/kung_fu_master_rainbow.safetensors"  # plays with the noise that it learned with
    assert cale.Policy(file).info["evaluation_samples"]
    as_trained, drawn, greedy = (cale.evaluate(file, games=1, seed=3, sampled=sampled) for sampled in (None, True, False))
    assert (as_trained.mean, as_trained.lengths) == (drawn.mean, drawn.lengths)
    assert as_trained.lengths != greedy.lengths


def test_a_change_that_is_not_applied_is_said(repository):
    file = repository / "policies/road_runner_joystick.safetensors"
    with pytest.warns(UserWarning, match="terminal_on_life_loss=False is not applied: as in this policy's training"):
        changed = cale.evaluate(file, games=1, terminal_on_life_loss=False)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        same = cale.evaluate(file, games=1, terminal_on_life_loss=True)
    np.testing.assert_array_equal(changed.returns, same.returns)


def test_mistakes_get_a_sentence(repository, tmp_path):
    file = repository / "policies/road_runner_sac.safetensors"
    policy = cale.Policy(file)
    with pytest.raises(ValueError, match=r"observations are uint8 \[N, 2, 128\], not float64 \[2, 128\]"):
        policy.act(np.zeros((2, 128)))
    with pytest.raises(ValueError, match="choice must be one of greedy, sampled, as_evaluated, not 'best'"):
        policy.act(np.zeros((2, 128), np.uint8), "best")
    with pytest.raises(ValueError, match="cannot play there: it sees other observations"):
        cale.evaluate(policy, games=1, obs="pixels")
    with pytest.raises(ValueError, match="cannot play there: it was trained with action_space=continuous"):
        cale.evaluate(policy, games=1, action_space="full")
    with pytest.raises(ValueError, match="cannot play there: its actions do not place a paddle; leave paddle out"):
        cale.evaluate(policy, games=1, game="breakout", paddle="absolute")
    with pytest.raises(FileNotFoundError, match="road_runner.bin is not in /nowhere.*pip install ale-py"):
        cale.evaluate(policy, games=1, rom_dir="/nowhere")
    for refused in (lambda: cale.Policy(file, seed=-1), lambda: cale.evaluate(policy, games=1, seed=-1)):
        with pytest.raises(ValueError, match="seed is -1: it must be from 0 to"):
            refused()
    with pytest.raises(ValueError, match="games is 0: it must be at least 1"):
        cale.evaluate(policy, games=0)
    damaged = tmp_path / "damaged.safetensors"
    damaged.write_bytes(file.read_bytes()[:-1])
    with pytest.raises(RuntimeError, match="damaged.safetensors' cannot be used"):
        cale.Policy(damaged)
    with pytest.raises(RuntimeError, match="nowhere.safetensors"):
        cale.Policy(tmp_path / "nowhere.safetensors")


def test_ctrl_c_does_not_wait_for_the_end_of_games(repository):
    policy = cale.Policy(repository / "policies/road_runner_sac.safetensors")

    def interrupt(*_):
        raise KeyboardInterrupt

    before = signal.signal(signal.SIGALRM, interrupt)
    signal.setitimer(signal.ITIMER_REAL, 0.3)
    try:
        with pytest.raises(KeyboardInterrupt):
            cale.evaluate(policy, games=100_000, threads=2)
    finally:
        signal.signal(signal.SIGALRM, before)
    stop = cale._core.Stop()
    stop.request()
    texts = texts_of({**policy.settings, "max_frames_per_episode": 108_000})
    with pytest.raises(RuntimeError, match="the game was stopped"):
        cale._core.play_game(policy._core, texts, 0.0, False, 1, 0, stop)


def test_names_that_are_not_utf8_are_refused(repository, tmp_path):
    policy = (repository / "policies/road_runner_sac.safetensors").read_bytes()
    (tmp_path / "named.safetensors").write_bytes(policy)
    assert cale.Policy(os.fsencode(tmp_path / "named.safetensors")).info["game"] == "RoadRunner"
    with pytest.raises(ValueError, match="file is '.*udcff', which is not UTF-8"):
        cale.Policy(os.fsdecode(b"\xff"))
    with pytest.raises(ValueError, match="rom_dir is '.*udcff', which is not UTF-8"):
        cale.make_vec("pong", rom_dir=os.fsdecode(b"\xff"))
    with pytest.raises(ValueError, match="game is '.*udcff', which is not UTF-8"):
        cale.make_vec(["pong", os.fsdecode(b"\xff")])


def test_a_policy_of_a_newer_version_says_so(repository):
    policy = cale.Policy(repository / "policies/road_runner_sac.safetensors")
    config = policy.info["provenance"]["config"]
    policy.info["provenance"]["config"] = config.replace("env:\n", "env:\n  new_thing: 3\n")
    with pytest.raises(ValueError, match="is of a newer cale: this one does not know its setting 'new_thing'"):
        policy.settings
