"""Threads, processes and memory: what must not hang, crash or leak."""
import gc
import importlib.util
import os
import pathlib
import subprocess
import sys
import textwrap
import threading
import time
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest

import cale


def run(script, timeout=120, **environment):
    """Runs a script in an interpreter of its own."""
    # Python 3.12 and later warn of every fork beside threads, which is what some of these scripts try.
    command = [sys.executable, "-W", "ignore::DeprecationWarning", "-c", textwrap.dedent(script)]
    return subprocess.run(command, capture_output=True, text=True, timeout=timeout, env=os.environ | environment)


def test_the_roms_of_ale_py_are_found(tmp_path):
    cache = pathlib.Path(os.environ.get("XDG_CACHE_HOME", pathlib.Path.home() / ".cache"))
    roms = pathlib.Path(os.environ.get("CALE_DEPS_DIR", cache / "cale")) / "roms"
    (tmp_path / "ale_py").mkdir()
    (tmp_path / "ale_py/__init__.py").write_text("raise ImportError('it need not be imported')")
    (tmp_path / "ale_py/roms").symlink_to(roms)
    make = "import cale; cale.Env('pong')"
    if importlib.util.find_spec("ale_py") is None:
        without = run(make, CALE_DEPS_DIR="/nowhere", ALE_ROMS_DIR="")
        assert "FileNotFoundError: the ROM file pong.bin is not in /nowhere/roms: run scripts/setup" in without.stderr
    for found in ({"PYTHONPATH": str(tmp_path)}, {"ALE_ROMS_DIR": str(roms)}):
        ran = run(make, **{"CALE_DEPS_DIR": "/nowhere", "ALE_ROMS_DIR": "", **found})
        assert (ran.returncode, ran.stderr) == (0, "")
    (tmp_path / "pong.bin").symlink_to(roms / "pong.bin")
    with pytest.raises(FileNotFoundError, match="breakout.bin is not in .*pip install ale-py"):
        cale.make_vec(["pong", "breakout"], num_envs=2, rom_dir=str(tmp_path))


def test_the_interpreter_ends_while_environments_step():
    """A thread steps, another step is in the background, and the main thread is at its end."""
    ended = run("""
        import threading, time, cale
        envs, sent = cale.make_vec("pong", num_envs=4), cale.make_vec("pong", num_envs=4)
        envs.reset(seed=1), sent.reset(seed=1)
        steps = 0

        def step():
            global steps
            while True:
                try:
                    envs.step(envs.action_space.sample())
                except RuntimeError:  # the interpreter ends
                    return
                steps += 1

        threading.Thread(target=step, daemon=True).start()
        while steps < 10:
            time.sleep(0.01)
        sent.send(sent.action_space.sample())
        print("end", flush=True)
    """)
    assert (ended.returncode, ended.stdout, ended.stderr) == (0, "end\n", "")


def test_a_forked_process_is_refused_with_a_sentence_and_the_parent_goes_on():
    ended = run("""
        import os, sys, cale
        envs, env = cale.make_vec("pong", num_envs=4), cale.Env("pong")
        envs.reset(seed=1), env.reset(seed=1)
        child = os.fork()
        if child == 0:
            for call in (lambda: envs.step(envs.action_space.sample()), env.reset):
                try:
                    call()
                    os._exit(1)
                except RuntimeError as error:
                    print(error, flush=True)
            made_here = cale.make_vec("pong", num_envs=4)
            made_here.reset(seed=1)
            made_here.step(made_here.action_space.sample())
            envs.close()
            del envs, env
            sys.exit(7)
        _, status = os.waitpid(child, 0)
        print(os.waitstatus_to_exitcode(status))
        envs.step(envs.action_space.sample())
    """)
    assert (ended.returncode, ended.stderr) == (0, "")
    refused = "these environments were made before this process was forked"
    assert [line[:len(refused)] for line in ended.stdout.splitlines()] == [refused, refused, "7"]


def test_a_process_forked_while_a_thread_acts_uses_the_policy_and_ends(repository):
    policy = repository / "policies/road_runner_sac.safetensors"
    ended = run(f"""
        import os, sys, threading, time, cale, numpy
        policy = cale.Policy({str(policy)!r})
        observations = numpy.zeros((64, *policy.info["observation_shape"]), numpy.uint8)
        stop = threading.Event()
        def act():
            while not stop.is_set():
                policy.act(observations)
        thread = threading.Thread(target=act, daemon=True)
        thread.start()
        time.sleep(0.1)
        for _ in range(10):
            child = os.fork()
            if child == 0:
                policy.act(observations)
                sys.exit(7)
            _, status = os.waitpid(child, 0)
            assert os.waitstatus_to_exitcode(status) == 7
        stop.set()
        thread.join()
        print("end")
    """)
    assert (ended.returncode, ended.stdout, ended.stderr) == (0, "end\n", "")


def test_processes_of_gymnasiums_async_vector_environment():
    import gymnasium

    envs = gymnasium.make_vec("cale/Pong-v0", num_envs=2, vectorization_mode="async", obs="ram")
    ours = cale.make_vec("pong", num_envs=2, obs="ram")
    np.testing.assert_array_equal(envs.reset(seed=1)[0], ours.reset(seed=1)[0])
    for _ in range(5):
        actions = ours.action_space.sample()
        np.testing.assert_array_equal(envs.step(actions)[0], ours.step(actions)[0])
    envs.close()


def test_other_threads_run_while_environments_step():
    """A step that held the GIL would let the counting thread count nothing."""
    envs = cale.make_vec("pong", num_envs=16, env_threads=1)
    envs.reset(seed=1)
    counted, stop = 0, False

    def count():
        nonlocal counted
        while not stop:
            counted += 1
            time.sleep(0.0002)

    thread = threading.Thread(target=count)
    thread.start()
    before, most = counted, 0
    for _ in range(30):
        at = counted
        envs.step(envs.action_space.sample())  # some milliseconds
        most = max(most, counted - at)
    stop = True
    thread.join()
    assert counted > before and most >= 3


def test_threads_take_turns_at_the_same_environments():
    envs = cale.make_vec("pong", num_envs=2)
    envs.reset(seed=1)
    failures = []

    def step():
        try:
            for _ in range(50):
                envs.step(np.zeros((2, 3), np.float32))
                envs.ram()
        except Exception as error:
            failures.append(error)

    threads = [threading.Thread(target=step) for _ in range(4)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert not failures
    *_, infos = envs.step(np.zeros((2, 3), np.float32))
    assert envs._core.frame_number(0) == 4 * (4 * 50 + 1) and list(infos["frames"]) == [4, 4]


def test_environments_may_be_dropped_and_closed_while_they_step():
    """Before the step has begun in the background, in its midst, and after it."""
    for delay in (0, 0.001, 0.003, 0.1):
        for close in (True, False):
            envs = cale.make_vec("pong", num_envs=6, env_threads=1, copy=close)
            envs.reset(seed=1)
            envs.send(envs.action_space.sample())
            time.sleep(delay)
            if close:
                envs.close()
            del envs
    gc.collect()


def test_a_failure_in_a_worker_is_an_exception():
    """An episode that is over cannot be stepped: the environment itself says so, on its thread."""
    env = cale.Env("pong", max_frames_per_episode=8)
    env.reset(seed=1)
    state = env.save()
    for _ in range(2):
        env.step(env.action_space.sample())
    over = bytearray(env._core.save(0))
    at = bytes(over).index(b"1", bytes(over).index(b"noop_max"))  # "ended" and "must_restart", texts of one letter
    over[at] = ord("0")
    over[bytes(over).index(b"1", at)] = ord("0")
    env._core.restore(0, bytes(over))
    with pytest.raises(RuntimeError, match="the episode is over, or none was started"):
        env.step(env.action_space.sample())
    env.restore(state)  # and it is usable again
    env.step(env.action_space.sample())


def resident_bytes():
    return int(pathlib.Path("/proc/self/statm").read_text().split()[1]) * os.sysconf("SC_PAGE_SIZE")


def live(number):
    """Makes environments; some of them play, and are in the midst of a step at their end."""
    envs = cale.make_vec("pong", num_envs=1 + number % 2, obs="ram", copy=bool(number % 20))
    if number % 10 == 0:
        envs.reset(seed=number)
        envs.restore(envs.save())
        envs.step(envs.action_space.sample())
        envs.send(envs.action_space.sample())
    if number % 3:
        envs.close()


@pytest.mark.skipif("asan" in os.environ.get("LD_PRELOAD", ""), reason="AddressSanitizer keeps what is freed for a while")
def test_a_thousand_creations_leak_nothing():
    """An environment takes about 0.9 MB: all of them would be 900 MB, a kilobyte of each 1 MB."""
    with ThreadPoolExecutor(2) as pool:
        list(pool.map(live, range(100)))
        before = resident_bytes()
        list(pool.map(live, range(1000)))
    grown = resident_bytes() - before
    print(f"1,000 creations: {grown / 1e6:.2f} MB more")
    assert grown < 4e6
    assert len(os.listdir("/proc/self/task")) < 40
