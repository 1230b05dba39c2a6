#!/usr/bin/env python3
"""What a reader must open stays within the budgets of docs/architecture.md. Run as: budgets.py SOURCE_DIR

Reading from a source means its own #includes, theirs, and the source beside every header.
"""
import pathlib
import re
import sys

ROOT = pathlib.Path(sys.argv[1])
FOLDERS = ("world cale policy networks storage terminal replay dopamine parallel agents settings report evaluate "
           "train sweep play tools python web").split()
INCLUDE = re.compile(r'\s*#include\s+["<]([^">]+)[">]')

READING = {"agents/sac.cpp": (40, 3500), "agents/ppo.cpp": (56, 4750)}  # files, lines
PAIRS = {"sac": 220, "sacd": 260, "dqn": 260, "der": 260, "ppo": 300}
SHARE_OF_A_FOLDER = 0.16
SHARED_LINES = 6


def lines(path):
    return (ROOT / path).read_text().splitlines()


def closure(start):
    seen, todo = set(), [start]
    while todo:
        path = todo.pop()
        if path in seen:
            continue
        seen.add(path)
        for line in lines(path):
            match = INCLUDE.match(line)
            if match and "/" in match[1] and (ROOT / match[1]).exists():
                todo.append(match[1])
                source = re.sub(r"\.h$", ".cpp", match[1])
                if source != match[1] and (ROOT / source).exists():
                    todo.append(source)
    return seen


def runs_of_code(agent):
    """Every run of SHARED_LINES lines of an agent's header and source, beyond includes and blank lines."""
    for suffix in (".h", ".cpp"):
        code = [line.strip() for line in lines(f"agents/{agent}{suffix}")]
        code = [line for line in code if line and not line.startswith(("#", "//"))]
        for i in range(len(code) - SHARED_LINES + 1):
            yield "\n".join(code[i:i + SHARED_LINES])


def main():
    mistakes = []
    for start, (most_files, most_lines) in READING.items():
        files = closure(start)
        count = sum(len(lines(f)) for f in files)
        print(f"{start}: {len(files)} files, {count} lines (budget {most_files}, {most_lines})")
        if len(files) < 10:
            mistakes.append(f"only {len(files)} files are read from {start}: is the folder right?")
        if len(files) > most_files or count > most_lines:
            mistakes.append(f"reading {start} takes {len(files)} files and {count} lines, "
                            f"more than {most_files} and {most_lines}")
    for agent, most in PAIRS.items():
        count = len(lines(f"agents/{agent}.h")) + len(lines(f"agents/{agent}.cpp"))
        print(f"agents/{agent}: {count} lines (budget {most})")
        if count > most:
            mistakes.append(f"agents/{agent}.h and .cpp have {count} lines, more than {most}")
    sizes = {folder: sum(len(lines(path)) for suffix in ("h", "cpp") for path in (ROOT / folder).rglob(f"*.{suffix}"))
             for folder in FOLDERS}
    total = sum(sizes.values())
    folder, largest = max(sizes.items(), key=lambda item: item[1])
    print(f"largest folder: {folder}, {100 * largest / total:.1f} % (budget {100 * SHARE_OF_A_FOLDER:.0f} %)")
    if largest > SHARE_OF_A_FOLDER * total:
        mistakes.append(f"{folder}/ holds {100 * largest / total:.1f} % of the code")
    seen = {}
    for agent in PAIRS:
        for run in runs_of_code(agent):
            other = seen.setdefault(run, agent)
            if other != agent:
                mistakes.append(f"agents/{agent} and agents/{other} share these lines:\n{run}")
    sys.exit("\n".join(mistakes) or 0)


main()
