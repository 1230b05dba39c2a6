"""Prints the mean training returns of a sweep's runs in every 10,000 agent steps.

    python3 docs/results/windows.py RUNS

RUNS holds folders Game__variant__seed. `mean` is the mean over the seeds of a run's mean return over the games that ended in
the 10,000 steps up to `steps`; `games` is how many these were.
"""
import collections
import csv
import pathlib
import sys

WINDOW = 10_000
AGENTS = {
    "sac__config=ram100k_plus": "SAC plus",
    "sac__joystick=cartesian": "SAC plus",
    "sac__config=ram100k_plus__critic_atoms=1": "SAC plus with critics of the mean",
    "sac__config=ram100k_plus__paddle=absolute": "SAC plus on an absolute paddle",
    "der__config=ram100k_joystick": "joystick Rainbow",
    "der__config=ram100k_joystick__random_warmup=false": "joystick Rainbow without a random warm-up",
    "sac__config=atari100k__encoder=mlp": "the paper's SAC",
    "sac__config=atari100k_plus": "SAC plus",
    "sac__config=atari100k_plus__critic_atoms=1": "SAC plus with critics of the mean",
    "der__action_latency=0__config=ram100k_joystick": "no latency",
    "der__action_latency=4__config=ram100k_joystick": "latency 4",
    "der__action_latency=0-8__config=ram100k_joystick": "latency 0-8",
    "der__action_latency=4__config=ram100k_joystick__observe_joystick=true": "latency 4; sees the joystick",
    "der__action_latency=0-8__config=ram100k_joystick__observe_joystick=true": "latency 0-8; sees the joystick",
    "sac__config=ram100k_plus__paddle=joystick": "SAC plus",
    "der__config=ram100k_joystick__action_space=minimal__joystick=polar": "Rainbow on the game's own actions",
    "der__config=joystick100k": "joystick Rainbow",
    "sac__config=atari100k": "the paper's SAC",
    "der__config=atari100k__encoder=data_efficient__action_space=full": "DER with 18 actions",
    "der__config=atari100k__encoder=data_efficient__action_space=continuous__joystick=factored__noisy_evaluation=true":
        "DER with the joystick's heads",
    "der__config=atari100k__action_space=continuous__joystick=factored__noisy_evaluation=true":
        "DER with the joystick's heads",
    "der__config=joystick100k__update_horizon=10": "10-step joystick Rainbow",
    "der__config=joystick100k__update_horizon=10__distributional=true": "10-step joystick Rainbow with C51",
    "der__config=joystick100k__update_horizon=10__distributional=true__max_frames_per_episode=18_000":
        "five-minute Rainbow",
    "der__config=joystick100k__encoder=phi_dqn_2013__update_horizon=10__distributional=true"
    "__max_frames_per_episode=18_000": "five-minute Rainbow",
    "der__update_horizon=10": "10-step joystick Rainbow",
    "der__update_horizon=3": "3-step joystick Rainbow",
    "der__update_horizon=3__distributional=true": "3-step joystick Rainbow with C51",
    "der__update_horizon=10__distributional=true__dueling=true__prioritised=true__learning_rate=1e-4"
    "__adam_epsilon=1.5e-4__target_update_period=2_000__layer_norm=false": "joystick Rainbow with DER's settings",
}


def rows_of(text):
    return list(csv.DictReader(line for line in text.splitlines() if not line.startswith("#")))


def mean(values):
    values = list(values)
    return sum(values) / len(values)


def returns_of(runs):
    """Returns the training returns in each window: by game, agent and steps, and there by seed."""
    cells = collections.defaultdict(dict)
    for run in sorted(pathlib.Path(runs).glob("*__*")):
        game, *variant, seed = run.name.split("__")
        agent = AGENTS.get("__".join(variant), "__".join(variant))
        reached = int(rows_of((run / "progress.csv").read_text())[-1]["global_step"])
        for row in rows_of((run / "episodes.csv").read_text()):
            steps = -(-int(row["global_step"]) // WINDOW) * WINDOW
            if steps <= reached:
                cells[game, agent, steps].setdefault(seed, []).append(float(row["r"]))
    return cells


def table_of(cells):
    lines = ["game,agent,steps,runs,games,mean"]
    for (game, agent, steps), seeds in sorted(cells.items()):
        score = mean(map(mean, seeds.values()))
        lines.append(f"{game},{agent},{steps},{len(seeds)},{sum(map(len, seeds.values()))},{score:.2f}")
    return "\n".join(lines) + "\n"


if __name__ == "__main__":
    print(table_of(returns_of(sys.argv[1])), end="")
