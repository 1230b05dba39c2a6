"""What Gymnasium's checks do not look at: seeds, memory, asynchronous steps, exact states, mistakes."""
import typing
import zlib

import gymnasium
import numpy as np
import pytest

import cale


def rollout(envs, steps, seed=0):
    """What so many random steps bring, in one list of arrays."""
    envs.action_space.seed(seed)
    result = []
    for _ in range(steps):
        observations, rewards, terminated, truncated, infos = envs.step(envs.action_space.sample())
        result += [observations.copy(), rewards.copy(), terminated.copy(), truncated.copy(), infos["frame_events"].copy()]
    return result


def same(a, b):
    return len(a) == len(b) and all(np.array_equal(x, y) for x, y in zip(a, b))


def test_a_seed_repeats_and_another_does_not():
    envs = cale.make_vec("ms_pacman", num_envs=2, noop_max=30)
    envs.reset(seed=0)
    first = rollout(envs, 60)
    envs.reset(seed=0)
    assert same(first, rollout(envs, 60))
    envs.reset()  # goes on with the random numbers that it has
    assert not same(first, rollout(envs, 60))
    envs.reset(seed=[0, 1])
    assert same(first, rollout(envs, 60))
    other = cale.make_vec("ms_pacman", num_envs=2, noop_max=30, env_threads=1)
    other.reset(seed=1)
    assert not same(first, rollout(other, 60))
    large = 2**63 + 5  # as Stable-Baselines3 may draw them
    other.reset(seed=large)
    second = rollout(other, 30)
    other.reset(seed=large)
    assert same(second, rollout(other, 30))


def test_environments_without_a_seed_differ():
    envs = cale.make_vec("ms_pacman", num_envs=4, noop_max=30)
    observations, _ = envs.reset()
    assert len({row.tobytes() for row in observations}) > 1


@pytest.mark.parametrize("make", [lambda: cale.Env("pong"), lambda: cale.make_vec("pong", num_envs=2)])
def test_the_seed_that_a_first_reset_drew_repeats_it(make):
    first, again = make(), make()
    first.reset()
    again.reset(seed=first.np_random_seed)
    action = np.zeros(first.action_space.shape, np.float32)
    for _ in range(60):  # Pong's ball flies by chance
        np.testing.assert_array_equal(first.step(action)[0], again.step(action)[0])


def test_the_types_of_arguments_can_be_asked_for():
    for function in (cale.Env.__init__, cale.VectorEnv.__init__, cale.make_vec):
        assert "render_mode" in typing.get_type_hints(function)


def test_a_partial_reset_touches_the_others_not():
    envs, twin = (cale.make_vec("breakout", num_envs=3, obs="ram") for _ in range(2))
    envs.reset(seed=5), twin.reset(seed=5)
    rollout(envs, 20), rollout(twin, 20)
    observations, infos = envs.reset(seed=5, options={"reset_mask": np.array([False, True, False])})
    fresh, _ = cale.make_vec("breakout", num_envs=3, obs="ram").reset(seed=5)
    np.testing.assert_array_equal(observations[1], fresh[1])  # environment i has seed + i
    assert list(infos["_lives"]) == [False, True, False]
    infos["_lives"][0] = True
    assert list(infos["_frames"]) == [False, True, False]
    a, b = rollout(envs, 20, seed=1), rollout(twin, 20, seed=1)
    for x, y in zip(a, b):
        np.testing.assert_array_equal(x[[0, 2]], y[[0, 2]])


def test_memory_belongs_to_whom_the_docstring_says():
    fresh, kept = cale.make_vec("pong", num_envs=2), cale.make_vec("pong", num_envs=2, copy=False)
    first, _ = fresh.reset(seed=3)
    before = first.copy()
    first_kept, _ = kept.reset(seed=3)
    action = fresh.action_space.sample()
    for _ in range(30):
        new, new_kept = fresh.step(action), kept.step(action)
        assert all(np.array_equal(a, b) for a, b in zip(new[:4], new_kept[:4]))
    np.testing.assert_array_equal(first, before)
    assert not np.shares_memory(first, new[0]) and np.shares_memory(first_kept, new_kept[0])
    first[:] = 0  # what the caller does to an old observation does not show in the next
    new[0][:] = 0
    np.testing.assert_array_equal(fresh.step(action)[0], kept.step(action)[0])
    kept.close()
    assert new_kept[0].sum() > 0  # outlives the environments


def test_observations_travel_by_dlpack():
    observations, _ = cale.make_vec("pong", num_envs=2).reset(seed=1)
    np.testing.assert_array_equal(np.from_dlpack(observations), observations)


@pytest.mark.parametrize("copy", [True, False])
def test_send_and_recv_are_step(copy):
    envs, twin = cale.make_vec("breakout", num_envs=3, copy=copy), cale.make_vec("breakout", num_envs=3)
    envs.reset(seed=1), twin.reset(seed=1)
    for _ in range(60):
        actions = envs.action_space.sample()
        envs.send(actions)
        sent, actions[:] = actions.copy(), 0  # what was sent is copied
        with pytest.raises(RuntimeError, match=r"a step is under way: call recv\(\) first"):
            envs.step(actions)
        for mine, other in zip(envs.recv()[:4], twin.step(sent)[:4]):
            np.testing.assert_array_equal(mine, other)
    with pytest.raises(RuntimeError, match=r"nothing was sent: call send\(\) first"):
        envs.recv()


@pytest.mark.parametrize("kind", [{}, {"obs": "ram"}, {"stick_speed": 0.2, "action_latency": "0-8"},
                                  {"paddle": "absolute"}, {"terminal_on_life_loss": True}])
def test_a_saved_state_continues_exactly(kind):
    """In the same environments, in new ones, one by one, and in a single environment."""
    settings = {"max_frames_per_episode": 400, **kind}
    envs = cale.make_vec("breakout", num_envs=3, **settings)
    envs.reset(seed=1)
    rollout(envs, 130)
    state = envs.save()
    expected = rollout(envs, 150, seed=3)
    envs.restore(state)
    assert same(expected, rollout(envs, 150, seed=3))
    other = cale.make_vec("breakout", num_envs=3, **settings)
    other.restore(state)
    singles = [other.save(i) for i in range(3)]
    assert same(expected, rollout(other, 150, seed=3))
    for i in (2, 1, 0):
        observations, _ = other.restore(singles[i], index=i)
    assert same(expected, rollout(other, 150, seed=3))
    single = cale.Env("breakout", **settings)
    observation, _ = single.restore(singles[1])
    np.testing.assert_array_equal(observation, observations[1])
    assert single.save() == singles[1]


def test_qbert_is_restored_where_the_emulators_own_state_is_not_enough():
    """ALE's state lacks a field of Q*bert's cartridge: an archive of such states loses games."""
    env = cale.Env("qbert", action_space="minimal", sticky_probability=0.25)
    env.reset(seed=2)
    env.action_space.seed(2)
    for _ in range(100):
        env.step(env.action_space.sample())
    state = env.save()
    actions = [env.action_space.sample() for _ in range(200)]

    def continued(env):
        return [env.step(action)[0].copy() for action in actions]

    expected = continued(env)
    other = cale.Env("qbert", action_space="minimal", sticky_probability=0.25)
    other.restore(state)
    assert same(expected, continued(other))


def test_damaged_and_foreign_states_are_refused():
    envs = cale.make_vec("pong", num_envs=2)
    envs.reset(seed=1)
    state = envs.save()
    for bad, sentence in [(b"", "no state that"), (state[:-9], "cut off or damaged"), (state[:20], "cut off or damaged"),
                          (state[:13] + zlib.compress(b"abc"), "cut off or damaged"),
                          (envs.save(0), "is of 1 environments, not of 2")]:
        with pytest.raises(ValueError, match=sentence):
            envs.restore(bad)
    with pytest.raises(ValueError, match="the saved environment has threshold=0.5, not 0.25"):
        cale.make_vec("pong", num_envs=2, threshold=0.25).restore(state)
    with pytest.raises(ValueError, match="the saved environment has game=pong, not breakout"):
        cale.make_vec("breakout", num_envs=2).restore(state)
    rng = np.random.default_rng(1)
    inner = bytearray(envs._core.save(0))
    for _ in range(200):  # no bytes do harm
        damaged = bytearray(inner)
        damaged[rng.integers(len(damaged))] ^= 1 << rng.integers(8)
        try:
            envs._core.restore(0, bytes(damaged[: rng.integers(1, len(damaged) + 1)]))
        except (ValueError, RuntimeError):
            pass
    envs.reset()
    envs.step(envs.action_space.sample())


def test_a_refused_state_changes_no_environment():
    envs = cale.make_vec("pong", num_envs=2, obs="ram")
    envs.reset(seed=1)
    earlier = envs.save()
    rollout(envs, 20)
    now = envs.ram()
    good = envs._core.save(0)
    with pytest.raises(ValueError, match="cut off or damaged"):
        envs._core.restore({0: cale._state.unpack(earlier)[0], 1: good[:-9]})
    np.testing.assert_array_equal(envs.ram(), now)
    envs.restore(earlier)
    assert not np.array_equal(envs.ram(), now)


def test_an_action_that_counts_for_nothing_may_be_anything():
    """As in Gymnasium's SyncVectorEnv: the step after an episode's last, with NEXT_STEP."""
    for kind, nothing in [({}, np.full((1, 3), np.nan, np.float32)), ({"action_space": "minimal"}, [-1]),
                          ({"joystick": "factored"}, [[-1, 7, 2]])]:
        envs = cale.make_vec("breakout", num_envs=1, max_frames_per_episode=8, **kind)
        envs.reset(seed=1)
        with pytest.raises(ValueError, match="the action of environment 0 is bad"):
            envs.step(nothing)
        *_, truncated, _ = envs.step(envs.action_space.sample())
        *_, truncated, _ = envs.step(envs.action_space.sample())
        assert truncated[0]
        _, rewards, _, truncated, infos = envs.step(nothing)
        assert rewards[0] == 0 and not truncated[0] and infos["frames"][0] == 0


def test_modes_have_gymnasiums_names_and_values():
    for mode in gymnasium.vector.AutoresetMode:
        for name in (mode, mode.name, mode.value):
            assert cale.make_vec("pong", 1, autoreset_mode=name).autoreset_mode is mode


def test_a_restored_ending_is_still_one():
    env = cale.Env("breakout", max_frames_per_episode=8)
    env.reset(seed=1)
    env.step(env.action_space.sample())
    running = env.save()
    assert env.step(env.action_space.sample())[4]["episode_over"]
    assert env.restore(env.save())[1]["episode_over"]
    assert not env.restore(running)[1]["episode_over"]


def test_a_lost_life_ends_an_episode_and_not_the_game():
    env = cale.Env("breakout", terminal_on_life_loss=True, sticky_probability=0, action_space="minimal")
    env.reset(seed=1)

    def to_the_end():
        for _ in range(2000):
            _, _, terminated, _, info = env.step(1)
            if terminated:
                return info
        raise AssertionError("no episode ended")

    info = to_the_end()
    assert info["lives"] == 4 and not info["episode_over"]
    with pytest.raises(RuntimeError, match="the episode of environment 0 is over: reset it first"):
        env.step(1)
    _, info = env.reset()
    assert info["lives"] == 4
    to_the_end()
    _, info = env.reset(options={"new_game": True})
    assert info["lives"] == 5


@pytest.mark.parametrize(("settings", "error", "sentence"), [
    ({"tresholdd": 1}, TypeError, "there is no setting 'tresholdd'; did you mean 'threshold'?"),
    ({"xyz": 1}, TypeError, r"there is no setting 'xyz'; cale.settings\(\) lists all of them"),
    ({"threshold": 2}, ValueError, "threshold must be 0 to 1, not '2'"),
    ({"threshold": float("nan")}, ValueError, "threshold must be a number, not 'nan'"),
    ({"obs": "pixel"}, ValueError, "obs must be one of pixels, ram, not 'pixel'; did you mean 'pixels'?"),
    ({"frame_skip": 0}, ValueError, "frame_skip must be 1 to 64, not '0'"),
    ({"frame_skip": 2.5}, ValueError, "frame_skip must be an integer, not '2.5'"),
    ({"terminal_on_life_loss": "perhaps"}, ValueError, "terminal_on_life_loss must be true or false, not 'perhaps'"),
    ({"threshold": {}}, TypeError, "threshold is a dict, which is no value of a setting"),
    ({"mode": 77}, ValueError, "mode is 77, which Breakout does not have: it has 0, 4"),
    ({"rom_dir": "/nowhere"}, FileNotFoundError, "breakout.bin is not in /nowhere.*pip install ale-py"),
    ({"num_envs": 0}, ValueError, "num_envs must be 1 to 1024, not '0'"),
    ({"game": "brekout"}, ValueError, "there is no game 'brekout'; did you mean breakout.$"),
    ({"render_mode": "human"}, ValueError, "render_mode must be None or 'rgb_array', not 'human'"),
    ({"autoreset_mode": "never"}, ValueError, "autoreset_mode must be one of NEXT_STEP, SAME_STEP, DISABLED, not 'never'"),
    ({"action_latency": (0, 2.5)}, TypeError, "action_latency is a tuple, which is no value of a setting"),
])
def test_mistakes_get_a_sentence(settings, error, sentence):
    with pytest.raises(error, match=sentence):
        cale.make_vec(**{"game": "breakout", **settings})


def test_environments_that_could_not_be_made_close():
    object.__new__(cale.VectorEnv).close_extras()  # as Gymnasium before 1.3 does, where a setting is refused


def test_bad_calls_get_a_sentence():
    envs = cale.make_vec("breakout", num_envs=2)
    with pytest.raises(RuntimeError, match=r"no episode was started: call reset\(\) first"):
        envs.step(envs.action_space.sample())
    mask = {"reset_mask": np.array([True, False])}
    with pytest.raises(ValueError, match="the first reset must be of all environments"):
        envs.reset(options=mask)
    envs.reset(seed=1)
    for seed, sentence in [(-1, "greater or equal to zero"), ([-1, 0], "seed is -1: it must be 0 or more"), ([1], "seed has 1 entries"),
                           (1.5, "seed is 1.5: give an integer"), ("12", "seed is '12': give an integer"),
                           ([1.5, 2.5], "cannot be interpreted as an integer")]:
        with pytest.raises(Exception, match=sentence):
            envs.reset(seed=seed)
    for options, sentence in [({"reset_masc": 1}, "no option 'reset_masc' of reset: they are reset_mask, new_game"),
                              ({"reset_mask": [True, False]}, "must be an array of 2 bool"),
                              ({"reset_mask": np.zeros(2, bool)}, "chooses no environment")]:
        with pytest.raises(ValueError, match=sentence):
            envs.reset(options=options)
    bad = envs.action_space.sample()
    bad[1, 1] = 4
    with pytest.raises(ValueError, match="the action of environment 1 is bad: theta is 4, it must lie in"):
        envs.step(bad)
    with pytest.raises(ValueError, match=r"actions have the shape \(2, 3\), not \(3, 3\)"):
        envs.step(np.zeros((3, 3)))
    with pytest.raises(ValueError, match=r"an action has the shape \(3,\), not \(2,\)"):
        cale.Env("pong").step(np.zeros(2))
    numbered = cale.make_vec("breakout", num_envs=2, action_space="minimal")
    numbered.reset(seed=1)
    with pytest.raises(ValueError, match="environment 1 is bad: there is no action 4, they are 0 to 3"):
        numbered.step([0, 4])
    with pytest.raises(ValueError, match="integers, not float64"):
        numbered.step([0.0, 1.0])
    with pytest.raises(TypeError, match="an Env is one environment: cale.make_vec makes several"):
        cale.Env("pong", num_envs=2)
    with pytest.raises(IndexError, match="there is no environment 2: they are 0 to 1"):
        envs.save(2)
    envs.close()
    envs.close()
    with pytest.raises(RuntimeError, match="these environments are closed"):
        envs.step(envs.action_space.sample())


def test_a_bad_action_steps_no_environment():
    envs, twin = (cale.make_vec("breakout", num_envs=2, action_space="minimal") for _ in range(2))
    envs.reset(seed=1), twin.reset(seed=1)
    for _ in range(20):
        with pytest.raises(ValueError):
            envs.step([1, 99])
        np.testing.assert_array_equal(envs.step([1, 2])[0], twin.step([1, 2])[0])


def test_the_same_game_in_whatever_actions_and_pictures():
    envs = cale.make_vec("Breakout", num_envs=1, render_mode="rgb_array", action_space="full")
    envs.reset(seed=1)
    assert envs.single_action_space.n == len(envs.action_meanings()) == 18
    (picture,) = envs.render()
    assert picture.shape == (210, 160, 3) and picture.max() > 0
    assert envs.ram().shape == (1, 128)
    assert envs.metadata["render_fps"] == 15
    env = cale.Env("ALE/Breakout-v5", action_space="minimal")
    env.reset(seed=1)
    assert env.action_meanings() == env.get_action_meanings() == ["NOOP", "FIRE", "RIGHT", "LEFT"] and env.render() is None


def test_several_games_are_played_in_turn():
    """Each as by itself; their states go from environment to environment of the same game."""
    envs = cale.make_vec(["pong", "breakout"], num_envs=4, obs="ram")
    assert envs.games == ("pong", "breakout", "pong", "breakout")
    envs.reset(seed=1)
    alone = [cale.Env(game, obs="ram") for game in envs.games]
    for i, env in enumerate(alone):
        env.reset(seed=1 + i)
    for _ in range(40):
        actions = envs.action_space.sample()
        observations, *_ = envs.step(actions)
        for i, env in enumerate(alone):
            np.testing.assert_array_equal(observations[i], env.step(actions[i])[0])
    envs.restore(envs.save(1), index=3)
    np.testing.assert_array_equal(envs.ram()[1], envs.ram()[3])
    with pytest.raises(ValueError, match="the saved environment has game=pong, not breakout"):
        envs.restore(envs.save(0), index=1)
    envs.reset(seed=1)
    for mistake in ({"num_envs": 3}, {"num_envs": 2, "action_space": "minimal"}):
        with pytest.raises(ValueError, match="env.game=pong,breakout"):
            cale.make_vec("pong,breakout", **mistake)
    with pytest.raises(ValueError, match="env.num_envs must be a multiple of the 2 games"):
        cale.Env(["pong", "breakout"])


def test_the_three_choices_of_a_factored_joystick():
    """x, y and the button, from left, from down, from up: ALE's numbers of the events."""
    envs = cale.make_vec("breakout", num_envs=1, joystick="factored", sticky_probability=0)
    envs.reset(seed=1)
    events = {(1, 1, 0): 0, (2, 1, 0): 3, (0, 1, 0): 4, (1, 2, 0): 2, (1, 0, 1): 13, (2, 2, 1): 14}
    for choices, event in events.items():
        *_, infos = envs.step([choices])
        assert infos["event"][0] == event, choices


def test_infos_of_sticks_and_paddles():
    envs = cale.make_vec("breakout", num_envs=2, stick_speed=0.1, action_latency=(np.int64(0), np.int64(0)))
    _, infos = envs.reset(seed=1)
    np.testing.assert_array_equal(infos["stick"], np.zeros((2, 3)))
    *_, infos = envs.step(np.array([[1, 0, 0]] * 2, np.float32))
    np.testing.assert_allclose(infos["stick"][:, 0], 0.4, atol=1e-6)
    envs = cale.make_vec("breakout", num_envs=2, paddle="absolute")
    envs.reset(seed=1)
    *_, infos = envs.step(np.array([[0, 0], [1, 0]], np.float32))
    np.testing.assert_array_equal(infos["paddle"], [0, 1])


def test_the_joystick_is_seen_beside_the_memory():
    envs = cale.make_vec("breakout", num_envs=2, obs="ram", observe_joystick=True, sticky_probability=0, frame_stack=2)
    observations, _ = envs.reset(seed=1)
    assert envs.single_observation_space.shape == observations.shape[1:] == (2, 128 + 18)
    observations, *_ = envs.step(np.array([[1, 0, 1], [0, 0, 0]], np.float32))
    np.testing.assert_array_equal(observations[:, -1, :128], envs.ram())
    np.testing.assert_array_equal(observations[0, -1, 128:], [255, 128, 255] * 6)
    np.testing.assert_array_equal(observations[1, -1, 128:], [128, 128, 0] * 6)
    with pytest.raises(ValueError, match="env.observe_joystick is for observations of the memory"):
        cale.make_vec("breakout", observe_joystick=True)


def test_the_version_is_the_projects(repository):
    assert f"project(cale VERSION {cale.__version__} " in (repository / "CMakeLists.txt").read_text()


def test_the_settings_are_those_of_the_table():
    import inspect

    names = {setting["name"] for setting in cale.settings()}
    assert {"threshold", "stick_speed", "obs", "paddle", "sticky_probability"} <= names
    parameters = inspect.signature(cale.make_vec).parameters
    assert names <= set(parameters)
    assert parameters["threshold"].default == 0.5 and parameters["stick_speed"].default is None
    assert "probability that a frame repeats the action before" in cale.make_vec.__doc__
    assert "tau: how far" in cale.Env.__init__.__doc__
    for setting in cale.settings():  # every default, given by name, is the default
        if setting["name"] not in ("game", "num_envs", "rom_dir"):
            cale.make_vec("pong", **{setting["name"]: setting["default"]}).close()
