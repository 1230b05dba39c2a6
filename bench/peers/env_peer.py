"""Agent steps per second of another environment under random actions: one JSON line.
     env_peer.py PEER GAME ENVIRONMENTS THREADS STEPS
   PEER: ale-py (continuous), ale-py-discrete, envpool, envpool-async (half of the environments per batch); and ours,
   from Python: cale, cale-discrete."""
import sys
import time

import numpy as np
from measure import report

peer, game, num_envs, threads, steps = sys.argv[1], sys.argv[2], *map(int, sys.argv[3:6])
random = np.random.default_rng(1)

if peer.startswith("cale"):
    import cale

    batch = num_envs
    env = cale.make_vec(game, num_envs, env_threads=threads, action_space="minimal" if peer == "cale-discrete" else "continuous")
    env.reset(seed=0)
elif peer.startswith("ale-py"):
    from ale_py.vector_env import AtariVectorEnv

    env = AtariVectorEnv(game=game, num_envs=num_envs, num_threads=threads, continuous=peer == "ale-py",
                         continuous_action_threshold=0.5, repeat_action_probability=0.25, frameskip=4,
                         stack_num=4, img_height=84, img_width=84, grayscale=True, maxpool=True, noop_max=0,
                         use_fire_reset=False, episodic_life=False, reward_clipping=False)
    batch = num_envs
    env.reset(seed=0)
else:
    import envpool

    batch = num_envs // 2 if peer == "envpool-async" else num_envs
    # Their frame skip, maximum, gray image, resize and stack are the defaults: 4 frames, 84x84x4.
    env = envpool.make(game.title().replace("_", "") + "-v5", env_type="gymnasium", num_envs=num_envs, batch_size=batch,
                       num_threads=threads, seed=0, repeat_action_probability=0.25, noop_max=1, use_fire_reset=False,
                       max_episode_steps=27_000)
    env.async_reset() if batch < num_envs else env.reset()

if peer in ("ale-py", "cale"):
    actions = random.uniform([0, -np.pi, 0], [1, np.pi, 1], size=(1000, batch, 3)).astype(np.float32)
else:
    count = (env.action_space if peer.startswith("envpool") else env.single_action_space).n
    actions = random.integers(count, size=(1000, batch), dtype=np.int32)

for i in range(-100, steps // batch):
    if i == 0:
        start = time.perf_counter()
    if batch == num_envs:
        env.step(actions[i % 1000])
    else:
        ids = env.recv()[4]["env_id"]
        env.send(actions[i % 1000], ids)
report(peer=peer, steps_per_second=steps // batch * batch / (time.perf_counter() - start))
