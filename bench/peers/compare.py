"""Ours against the peers on this machine, in turn, medians: what bench/compare runs. Tables on stdout, rows in a CSV."""
import argparse
import concurrent.futures
import csv
import json
import os
import re
import statistics
import subprocess
import sys
import tempfile

HERE = os.path.dirname(os.path.abspath(__file__))
ROOT = os.path.dirname(os.path.dirname(HERE))
BUILD = os.path.join(ROOT, "build")
BINARIES = os.path.join(BUILD, "bin")
CONFIGS = os.path.join(ROOT, "configs")
CORES = sorted(os.sched_getaffinity(0))
GAME = "pong"

# The peer, and the network it has: phi_* is the same as ours, "nature" its own, smaller one (unpadded convolutions).
UPDATES = [  # agent, encoder, name in bench_update, peers
    ("sac", "phi_sac", "sac_phi_sac", ["dopamine phi_sac"]),
    ("sac", "phi_dqn", "sac_phi_dqn", ["dopamine phi_dqn", "sb3 phi_dqn", "sb3 nature"]),
    ("sacd", "phi_dqn", "sacd_phi_dqn", ["cleanrl nature"]),
    ("dqn", "phi_dqn", "dqn", ["dopamine phi_dqn", "sb3 phi_dqn"]),
    ("dqn", "nature", "dqn_nature", ["sb3 nature", "cleanrl nature"]),
    ("der", "phi_dqn", "der", ["dopamine phi_dqn"]),
    ("der", "nature", "der_nature", ["cleanrl nature"]),
    ("ppo", "phi_sac", "ppo_phi_sac_minibatch", ["dopamine phi_sac"]),
    ("ppo", "phi_dqn", "ppo_phi_dqn_minibatch", ["dopamine phi_dqn", "sb3 phi_dqn"]),
    ("ppo", "nature", "ppo_nature_minibatch", ["sb3 nature", "cleanrl nature"]),
]
ATARI100K = "env.sticky_probability=0 env.terminal_on_life_loss=true "
RUNS = [  # agent, network, configuration, settings that make it what the peers run, peers
    ("sac", "phi_sac", "atari100k", "", ["dopamine phi_sac"]),
    ("sac", "phi_dqn", "atari100k", "agent.encoder=phi_dqn", ["sb3 nature"]),
    ("sacd", "phi_dqn", "atari100k", "agent.encoder=phi_dqn agent.min_replay=1600", ["cleanrl nature"]),
    ("dqn", "phi_dqn", "atari100k", "", ["dopamine phi_dqn"]),
    ("dqn", "nature", "atari100k", "agent.padding=valid", ["sb3 nature", "cleanrl nature"]),
    ("der", "phi_dqn", "atari100k", "", ["dopamine phi_dqn"]),
    ("der", "nature", "atari100k", "agent.padding=valid", ["cleanrl nature"]),
    ("ppo", "phi_sac", "atari100k", "", ["dopamine phi_sac"]),
    ("ppo", "nature", "discrete", ATARI100K + "agent.epochs=3", ["sb3 nature", "cleanrl nature"]),
]
SWEPT = [("sac", "phi_sac"), ("dqn", "nature"), ("der", "phi_dqn"), ("ppo", "nature")]  # of RUNS
SWEEP_CORES = 2
PPO_ENVIRONMENTS = [8, 32, 128]
DECISIONS = ["phi_sac", "phi_dqn", "impala"]
BATCHES = [1, 8, 64]
SHAPES = [(1, 1), (8, 1), (8, 2), (32, 2)]  # environments, threads

options = argparse.ArgumentParser(prog="bench/compare", description=__doc__)
options.add_argument("repetitions", nargs="?", type=int, default=5)
options.add_argument("--only", choices=["env", "update", "end-to-end", "ppo", "sweep", "decision"])
options.add_argument("--agent", choices=["sac", "sacd", "dqn", "der", "ppo"], help="of updates, runs and sweeps")
options.add_argument("--threads", type=int, nargs="+", choices=[1, 2], default=[1, 2], help="of updates and PPO")
options.add_argument("--seconds", type=float, default=5,
                     help="of one timed update; a peer's end-to-end window is 4 x as long, ours 360 agent steps (PPO: 2,048)")
DEFAULT_CSV = f"{BUILD}/bench.csv"  # whose folder the build makes
options.add_argument("--csv", default=DEFAULT_CSV)
options.add_argument("--check", action="store_true", help="check these options and stop")
options = options.parse_args()

if os.path.exists(options.csv):
    sys.exit(f"bench/compare: {options.csv} is there already, perhaps of hours of work: remove it, or name another --csv")
if options.csv != DEFAULT_CSV and not os.path.isdir(os.path.dirname(options.csv) or "."):
    sys.exit(f"bench/compare: there is no folder {os.path.dirname(options.csv)}: make it, or name another --csv")
# Decisions take one thread, updates and PPO those that are asked for, all else two.
needed = {"decision": 1, "update": max(options.threads), "ppo": max(options.threads)}.get(options.only, 2)
if len(CORES) < needed:
    sys.exit(f"bench/compare: this needs {needed} cores, and has {len(CORES)}: what is measured on two threads would share one")
if options.check:
    sys.exit()
if "CALE_PEERS" not in os.environ:
    sys.exit("run bench/compare: it installs the peers")
log = open(f"{BUILD}/bench.log", "w")
rows = []


def run(command, threads, first_core=0):
    """Output and peak memory in MB of a command that has THREADS cores to itself; None if it fails."""
    environment = os.environ | {"CALE_BENCH_SECONDS": str(options.seconds), "OMP_NUM_THREADS": str(threads)}
    cores = CORES[first_core:first_core + threads]
    process = subprocess.Popen([str(word) for word in command], stdout=subprocess.PIPE, stderr=log, text=True,
                               env=environment, preexec_fn=lambda: os.sched_setaffinity(0, cores))
    output = process.stdout.read()
    _, status, usage = os.wait4(process.pid, 0)
    process.returncode = os.waitstatus_to_exitcode(status)
    if process.returncode:
        print(f"left out: '{' '.join(map(str, command))}' failed with code {process.returncode}; see {log.name}")
        return None, None
    return output, usage.ru_maxrss / 1024


def peer(name, key, threads, *arguments, first_core=0):
    """KEY of the JSON line that the peer's script prints, and its peak memory."""
    folder, script = {"dopamine": ("jax", "dopamine"), "sb3": ("torch", "sb3"), "cleanrl": ("torch", "cleanrl"),
                      "onnx": ("env", "onnx")}.get(
        name, ("env", "env"))
    output, memory = run([f"{os.environ['CALE_PEERS']}/{folder}/bin/python", f"{HERE}/{script}_peer.py", *arguments],
                         threads, first_core)
    return (json.loads(output.splitlines()[-1])[key], memory) if output else None


def keep(**row):
    """At once: all of it takes hours, and what was measured before an error is worth having."""
    rows.append(row)
    with open(options.csv, "a", newline="") as table:
        writer = csv.DictWriter(table, row)
        if len(rows) == 1:
            writer.writeheader()
        writer.writerow(row)


def compare(section, agent, encoder, threads, unit, ours, peers):
    """Runs ours and every peer in turn; prints and keeps one row per peer. A function returns (value, memory)."""
    results = {name: [] for name in ["ours", *peers]}
    for _ in range(options.repetitions):
        for name, measure in [("ours", ours), *peers.items()]:
            if results[name] is not None:
                result = measure()
                results[name] = None if result is None else [*results[name], result]
            if results["ours"] is None:
                sys.exit("bench/compare: our own program failed")
    median = {name: [statistics.median(column) for column in zip(*values)] for name, values in results.items() if values}
    mine, my_memory = median.pop("ours")
    for name, (value, memory) in median.items():
        ratio = value / mine if unit == "ms" else mine / value
        keep(section=section, agent=agent, encoder=encoder, threads=threads, peer=name, unit=unit,
             cale=f"{mine:.4g}", theirs=f"{value:.4g}", ratio=f"{ratio:.2f}", cale_mb=f"{my_memory:.0f}",
             theirs_mb=f"{memory:.0f}", repetitions=options.repetitions)
        print(f"{agent:14} {encoder:10} {threads:7}   {name:22} {mine:10.4g} {value:10.4g} {ratio:8.2f}"
              + (f" {my_memory:9.0f} {memory:9.0f}" if section in ("end-to-end", "ppo", "sweep") else ""), flush=True)


def heading(text, first, second, *more):
    print(f"\n{text} (median of {options.repetitions})\n{first:14} {second:10} threads   {'peer':22} "
          f"{'cale':>10} {'peer':>10} {'ratio':>8}" + "".join(f" {column:>9}" for column in more), flush=True)


def available(names):
    return [name for name in names if not name.startswith("cleanrl") or "CALE_CLEANRL" in os.environ]


def environments():
    what = f"agent steps per second on {GAME}, sticky actions, 84x84"
    heading(f"Environment, ours from C++ and a frame a step, theirs from Python and four: {what}", "environments", "actions")
    for num_envs, threads in SHAPES:
        shape = [GAME, num_envs, threads, 6000]

        def ours(*space):
            def measure():
                output, memory = run([f"{BINARIES}/env_speed", *shape, *space], threads)
                return (float(output), memory) if output else None
            return measure

        def theirs(name):
            return lambda: peer(name, "steps_per_second", threads, name, *shape)

        compare("env", f"{num_envs}", "continuous", threads, "steps/s", ours(), {"ale-py": theirs("ale-py")})
        discrete = ["ale-py-discrete", "envpool"] + (["envpool-async"] if num_envs > 1 else [])
        compare("env", f"{num_envs}", "discrete", threads, "steps/s", ours("minimal"), {n: theirs(n) for n in discrete})

    heading(f"Environment, all from Python and four frames a step: {what}", "environments", "actions")
    for num_envs, threads in SHAPES:
        def python(name):
            return lambda: peer(name, "steps_per_second", threads, name, GAME, num_envs, threads, 6000)

        compare("python", f"{num_envs}", "continuous", threads, "steps/s", python("cale"), {"ale-py": python("ale-py")})
        compare("python", f"{num_envs}", "discrete", threads, "steps/s", python("cale-discrete"),
                {name: python(name) for name in ("ale-py-discrete", "envpool")})


def our_update(name, threads):
    output, memory = run([f"{BINARIES}/bench_update", f"--benchmark_filter=^{name}/{threads}/",
                          f"--benchmark_min_time={options.seconds}", "--benchmark_format=json"], threads)
    return (json.loads(output)["benchmarks"][0]["real_time"], memory) if output else None


def peer_update(name, agent, threads):
    library, encoder = name.split()
    if library == "cleanrl":
        return peer(library, "ms", threads, agent, options.seconds, threads)
    return peer(library, "ms", threads, "update", agent, encoder, *([threads] if library == "sb3" else []))


def updates():
    heading("Update: milliseconds per gradient step", "agent", "network")
    for agent, encoder, name, peers in UPDATES:
        for threads in options.threads:
            if options.agent in (None, agent):
                compare("update", agent, encoder, threads, "ms", lambda: our_update(name, threads),
                        {p: lambda p=p: peer_update(p, agent, threads) for p in available(peers)})


def our_run(agent, configuration, settings, threads, first_core=0):
    """A short run; its speed between two rows of progress.csv, after the replay's warm-up."""
    every, start = (1024, 2048) if agent == "ppo" else (180, 1620)
    with tempfile.TemporaryDirectory() as folder:
        output, memory = run([
            f"{BINARIES}/train_{agent}", "--config", f"{CONFIGS}/{agent}/{configuration}.yaml", f"env.game={GAME}",
            *settings.split(), f"train.total_steps={start + 2 * every}",
            f"log.every={every}", "eval.episodes=0", "--threads", threads, "--run-dir", f"{folder}/run",
            "--no-progress"], threads, first_core)
        if output is None:
            return None
        with open(f"{folder}/run/progress.csv") as file:
            time = {int(row["global_step"]): float(row["seconds"]) for row in csv.DictReader(file)}
    end = max(time)
    return (end - start) / (time[end] - time[start]), memory


def peer_run(name, agent, threads, *more, first_core=0):
    library, seconds = name.split()[0], 4 * options.seconds
    arguments = {"cleanrl": [agent, seconds, threads, *more], "sb3": ["run", agent, seconds, threads]}.get(
        library, ["run", agent, seconds])
    return peer(library, "steps_per_second", threads, *arguments, first_core=first_core)


def end_to_end():
    heading(f"End to end: agent steps per second at the 100k protocol on {GAME}, after the warm-up; peak memory in MB",
            "agent", "network", "cale MB", "peer MB")
    for agent, encoder, configuration, settings, peers in RUNS:
        if options.agent in (None, agent):
            compare("end-to-end", agent, encoder, 2, "steps/s",
                    lambda: our_run(agent, configuration, settings, 2),
                    {p: lambda p=p: peer_run(p, agent, 2) for p in available(peers)})


def numbers_of_environments():
    heading(f"PPO by the number of environments: agent steps per second on {GAME}; peak memory in MB", "environments",
            "network", "cale MB", "peer MB")
    _, encoder, configuration, settings, _ = RUNS[-1]
    for num_envs in PPO_ENVIRONMENTS:
        for threads in options.threads:
            scripts = {"cleanrl": "ppo", "cleanrl, envpool": "ppo-envpool"}
            compare("ppo", f"{num_envs}", encoder, threads, "steps/s",
                    lambda: our_run("ppo", configuration, f"{settings} env.num_envs={num_envs}", threads),
                    {p: lambda p=p: peer_run("cleanrl", scripts[p], threads, num_envs) for p in available(scripts)})


def together(measure):
    """What runs of one thread reach at once, each on a core of its own: the sums of their speeds and memories."""
    with concurrent.futures.ThreadPoolExecutor(SWEEP_CORES) as pool:
        results = list(pool.map(measure, range(SWEEP_CORES)))
    return None if None in results else [sum(column) for column in zip(*results)]


def sweeps():
    heading(f"Sweep: agent steps per second of all runs, {SWEEP_CORES} runs of one thread at once; memory of all in MB",
            "agent", "network", "cale MB", "peer MB")
    for agent, encoder, configuration, settings, peers in RUNS:
        if (agent, encoder) not in SWEPT or options.agent not in (None, agent):
            continue

        def ours(threads, first_core=0):
            return our_run(agent, configuration, settings, threads, first_core)

        others = {f"{p} x {SWEEP_CORES}": lambda p=p: together(lambda core: peer_run(p, agent, 1, first_core=core))
                  for p in available(peers)}
        alone = {f"cale, {t} thread{'s' * (t > 1)}": lambda t=t: ours(t) for t in (1, SWEEP_CORES)}
        compare("sweep", agent, encoder, SWEEP_CORES, "steps/s", lambda: together(lambda core: ours(1, core)),
                alone | others)


def our_decision(encoder, who, batch):
    output, memory = run([f"{BINARIES}/bench_policy", f"--benchmark_filter=^{encoder}/{who}/{batch}/",
                          f"--benchmark_min_time={options.seconds}", "--benchmark_format=json"], 1)
    return (json.loads(output)["benchmarks"][0]["real_time"], memory) if output else None


def decisions():
    heading("Decisions: milliseconds per batch of a policy file, on one core", "network", "batch")
    with tempfile.TemporaryDirectory() as folder:
        run([f"{BINARIES}/bench_policy", "--benchmark_filter=^nothing$", f"--onnx={folder}"], 1)
        for encoder in DECISIONS:
            for batch in BATCHES:
                peers = {"onnxruntime": lambda: peer("onnx", "ms", 1, f"{folder}/{encoder}.onnx", batch),
                         "cale::Policy": lambda: our_decision(encoder, "libtorch", batch)}
                compare("decision", encoder, batch, 1, "ms", lambda: our_decision(encoder, "lite", batch), peers)


model = re.search(r"model name\s*: (.*)", open("/proc/cpuinfo").read())
print(f"{model.group(1) if model else 'unknown processor'}, {os.cpu_count()} cores")
if os.getloadavg()[0] > 0.5:
    print(f"warning: the machine is busy (load {os.getloadavg()[0]:.1f}): these figures are not worth keeping")
if "CALE_CLEANRL" not in os.environ:
    print("CleanRL's rows are left out: set CALE_CLEANRL to a checkout of vwxyzjn/cleanrl")
for section, measure in {"env": environments, "update": updates, "end-to-end": end_to_end,
                         "ppo": numbers_of_environments, "sweep": sweeps, "decision": decisions}.items():
    if options.only in (None, section):
        measure()
if not rows:
    sys.exit("bench/compare: no peer has what was asked for; docs/performance.md says which has what")
print(f"\nAll rows: {options.csv}. Picture: bench/plot {options.csv} {BUILD}/performance.svg")
