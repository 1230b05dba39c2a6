"""What the peers' scripts share: a clock and the line they print."""
import json
import os
import sys
import time

WARM_UP = 3


def milliseconds(step):
    """Mean time of step() over CALE_BENCH_SECONDS (5) after three calls, as Google Benchmark reports ours."""
    for _ in range(WARM_UP):
        step()
    window, calls, start = float(os.environ.get("CALE_BENCH_SECONDS", 5)), 0, time.perf_counter()
    while (elapsed := time.perf_counter() - start) < window or calls < 3:
        step()
        calls += 1
    return 1e3 * elapsed / calls


class Window:
    """Agent steps per second from step 1,620 on: every off-policy agent learns from step 1,600 on.
    mark() looks at multiples of PERIOD only, and returns the speed once SECONDS have passed."""

    def __init__(self, seconds, period=1):
        self.seconds, self.period, self.steps, self.start = seconds, period, 0, None

    def mark(self, steps):
        self.steps = steps
        if steps < 1620 or steps % self.period:
            return None
        now = time.perf_counter()
        if self.start is None:
            self.start, self.first = now, steps
        return (steps - self.first) / (now - self.start) if now - self.start >= self.seconds else None


def report(**fields):
    """One JSON line on the real stdout (the peers print what they like on theirs)."""
    print(json.dumps({k: round(v, 3) if isinstance(v, float) else v for k, v in fields.items()}),
          file=sys.__stdout__, flush=True)
