"""Ratios of bench/compare as horizontal bars: plot.py FILE.csv PICTURE.svg"""
import csv
import sys

import matplotlib

matplotlib.use("Agg")
import matplotlib.pyplot as plt  # noqa: E402

# Okabe and Ito's palette: told apart with every kind of colour vision.
PEERS = {"ale-py": ("ale-py", "#56B4E9"), "envpool": ("EnvPool", "#0072B2"), "dopamine": ("Dopamine", "#D55E00"),
         "sb3": ("Stable-Baselines3", "#009E73"), "cleanrl": ("CleanRL", "#E69F00")}
NAMES = {"sac": "SAC", "sacd": "SAC-D", "dqn": "DQN", "der": "DER", "ppo": "PPO",
         "phi_sac": "φ_SAC", "phi_dqn": "φ_DQN", "nature": "Nature"}


def label(row):
    if row["section"] == "env":
        return row["encoder"] + (", async" if row["peer"].endswith("async") else "")
    smaller = row["peer"].endswith("nature") and row["encoder"] != "nature"
    smaller |= row["agent"] == "ppo" and row["peer"] == "sb3 phi_dqn"  # one dense layer for actor and critic, not two
    return f"{NAMES[row['agent']]} {NAMES[row['encoder']]}" + ("*" if smaller else "")


def panel(axes, title, rows, limits):
    values = [float(row["ratio"]) for row in rows]
    peers = [PEERS[row["peer"].split()[0].replace("-discrete", "").replace("-async", "")] for row in rows]
    bars = axes.barh(range(len(rows)), [value - 1 for value in values], left=1, height=0.72,
                     color=[colour for _, colour in peers])
    for y, value in enumerate(values):
        axes.annotate(f"{value:.2f}×" if value < 10 else f"{value:.0f}×", (value, y), fontsize=9, va="center",
                      xytext=(4 if value >= 1 else -4, 0), textcoords="offset points",
                      ha="left" if value >= 1 else "right")
    axes.set_yticks(range(len(rows)), [f"{label(row)} · {name}" for row, (name, _) in zip(rows, peers)], fontsize=9)
    axes.invert_yaxis()
    axes.set_xscale("log")
    axes.set_xlim(*limits)
    ticks = [t for t in (0.1, 0.2, 0.5, 1, 2, 5, 10, 20, 50, 100) if limits[0] <= t <= limits[1]]
    axes.set_xticks(ticks, [f"{t:g}×" for t in ticks], fontsize=9)
    axes.xaxis.set_minor_locator(matplotlib.ticker.NullLocator())
    axes.axvline(1, color="black", linewidth=1)
    axes.set_title(title, loc="left", fontsize=11, fontweight="bold")
    axes.spines[["top", "right", "left"]].set_visible(False)
    axes.tick_params(axis="y", length=0)
    return {name: bar for (name, _), bar in zip(peers, bars)}


def chosen(row):
    """Two threads, and eight environments: the rest is in docs/performance.md."""
    return row["threads"] == "2" and (row["section"] != "env" or row["agent"] == "8")


with open(sys.argv[1]) as file:
    rows = [row for row in csv.DictReader(file) if chosen(row)]
titles = {"env": "Environment, 8 games at once", "end-to-end": "End to end, Atari 100k", "update": "Gradient step"}
panels = [(titles[s], [row for row in rows if row["section"] == s]) for s in titles]
panels = [(title, content) for title, content in panels if content]
if not panels:
    sys.exit(f"bench/plot: {sys.argv[1]} has no rows for two threads")

# One scale for all; room for the figures at both ends.
ratios = [float(row["ratio"]) for _, content in panels for row in content]
limits = min(0.8, *ratios) / 1.7, max(2, *ratios) * 1.5

matplotlib.rcParams["svg.fonttype"] = "none"
matplotlib.rcParams["font.family"] = "sans-serif"
figure, columns = plt.subplots(
    len(panels), 1, figsize=(8, 1.2 + sum(0.6 + 0.26 * len(content) for _, content in panels)), squeeze=False,
    gridspec_kw={"height_ratios": [len(content) + 1.2 for _, content in panels]}, layout="constrained")
handles = {}
for axes, (title, content) in zip(columns[:, 0], panels):
    handles |= panel(axes, title, content, limits)
figure.suptitle("Speed of cale relative to its peers, two CPU threads (right of 1×: cale is faster)", fontsize=12,
                x=0.01, ha="left")
note = "* the peer's own network is smaller than ours" if any("*" in label(r) for _, c in panels for r in c) else None
figure.legend(handles.values(), handles.keys(), loc="outside lower center", ncols=len(handles), frameon=False,
              fontsize=9, title=note, title_fontsize=9)
figure.savefig(sys.argv[2], facecolor="white")
