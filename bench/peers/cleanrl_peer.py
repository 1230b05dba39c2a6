"""CleanRL's own scripts, run as they are out of a checkout (CALE_CLEANRL), with a clock set between their statements.
     cleanrl_peer.py AGENT SECONDS THREADS [ENVIRONMENTS]     at the 100k protocol, real ALE
   Prints ms per gradient step, without the replay's work, and agent steps per second.
   AGENT: dqn, der, ppo, ppo-envpool, sacd; PPO's have 8 ENVIRONMENTS by themselves and 1,024 steps in a rollout.
   CleanRL is not installed: its last release on PyPI is of 2021 and has no such scripts."""
import ast
import os
import sys
import tempfile
import time
import types

agent, seconds, threads = sys.argv[1], float(sys.argv[2]), int(sys.argv[3])
environments = int(sys.argv[4]) if len(sys.argv) > 4 else 8
checkout = os.path.abspath(os.environ["CALE_CLEANRL"])
sys.path[:0] = [checkout]

import torch  # noqa: E402
from ale_py.registration import register_v0_v4_envs  # noqa: E402
from measure import Window, report  # noqa: E402

SCRIPT = {"dqn": "dqn_atari", "der": "rainbow_atari", "ppo": "ppo_atari", "ppo-envpool": "ppo_atari_envpool",
          "sacd": "sac_atari"}
ROLLOUT = f"--update-epochs 3 --num-envs {environments} --num-steps {1024 // environments}"
REPLAY = "--buffer-size 100000 --learning-starts 1600 "
GAME = "Pong-v5" if agent == "ppo-envpool" else "PongNoFrameskip-v4"
ARGUMENTS = f"--env-id {GAME} --total-timesteps 100000 --no-cuda " + {
    "dqn": REPLAY + "--train-frequency 1 --target-network-frequency 2000",
    "der": REPLAY + "--train-frequency 1 --target-network-frequency 2000 --n-step 10",
    "ppo": ROLLOUT, "ppo-envpool": ROLLOUT,
    "sacd": REPLAY + "--update-frequency 4"}[agent]


class Clock(Window):
    """Also sums what lies between begin(name) and end(name) in the window."""

    def __init__(self):
        super().__init__(seconds)
        self.began, self.total, self.updates = {}, {"update": 0, "replay": 0}, 0

    def begin(self, name):
        self.began[name] = time.perf_counter()

    def end(self, name):
        if self.start is not None:
            self.total[name] += time.perf_counter() - self.began[name]
            self.updates += name == "update"

    def mark_step(self, step):
        if speed := self.mark(step):
            replay = 1e3 * self.total["replay"] / self.updates
            report(peer="cleanrl", agent=agent, encoder="nature",
                   ms=1e3 * self.total["update"] / self.updates - replay, steps_per_second=speed)
            sys.exit()


def statement(text):
    return ast.parse(text).body[0]


def timed(name, body):
    return [statement(f"clock.begin('{name}')"), *body, statement(f"clock.end('{name}')")]


def calls_replay(node):
    return isinstance(node, (ast.Assign, ast.Expr)) and ast.unparse(getattr(node, "value", node)).startswith(
        ("rb.sample(", "rb.update_priorities("))


class Instrument(ast.NodeTransformer):
    def visit_If(self, node):
        """The gradient step of the off-policy scripts: the block that samples the replay."""
        self.generic_visit(node)
        if any(calls_replay(child) for child in node.body):
            node.body = timed("update", [s for child in node.body for s in (
                timed("replay", [child]) if calls_replay(child) else [child])])
        return node

    def visit_For(self, node):
        self.generic_visit(node)
        if ast.unparse(node.target) == "start":
            node.body = timed("update", node.body)
        elif ast.unparse(node.target) in ("global_step", "iteration"):
            node.body.insert(0, statement("clock.mark_step(global_step)"))
        return node


def old_envpool():
    """EnvPool with the interface of 2022 that the script was written for, as `envpool`; it gets THREADS."""
    import envpool
    import gym

    class Old(gym.Env):
        def __init__(self, pool, num_envs):
            self.pool, self.num_envs = pool, num_envs
            self.observation_space = gym.spaces.Box(0, 255, (4, 84, 84), "uint8")
            self.action_space = gym.spaces.Discrete(int(pool.action_space.n))

        def reset(self):
            return self.pool.reset()[0]

        def step(self, actions):
            observations, rewards, terminated, truncated, infos = self.pool.step(actions)
            return observations, rewards, terminated | truncated, infos

    def make(game, num_envs, **options):
        return Old(envpool.make(game, num_envs=num_envs, num_threads=threads, **options), num_envs)

    sys.modules["envpool"] = types.SimpleNamespace(make=make)


torch.set_num_threads(threads)
if agent == "ppo-envpool":
    old_envpool()
register_v0_v4_envs()
path = os.path.join(checkout, "cleanrl", SCRIPT[agent] + ".py")
tree = ast.fix_missing_locations(Instrument().visit(ast.parse(open(path).read())))
sys.argv = [path, *ARGUMENTS.split()]
with tempfile.TemporaryDirectory() as folder:
    os.chdir(folder)
    sys.stdout = open(os.devnull, "w")
    exec(compile(tree, path, "exec"), {"__name__": "__main__", "__file__": path, "clock": Clock()})
