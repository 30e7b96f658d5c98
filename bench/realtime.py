"""Runs in realtime, each with cyclictest in the same seconds; for bench/run."""

import json
import os
import pathlib
import shutil
import subprocess
import sys
import tempfile


def quantiles(counts):
    """p50, p99, p99.9 and the longest of a cyclictest histogram: latency [us] -> how often."""
    latencies = sorted(counts)
    total, seen, found = sum(counts.values()), 0, []
    for latency in latencies:
        seen += counts[latency]
        while len(found) < 3 and seen >= (0.5, 0.99, 0.999)[len(found)] * total:
            found.append(latency)
    return [*found, latencies[-1]]


def stolen_s():
    """What the host of this virtual machine has taken from it so far [s], summed over the processors."""
    return int(pathlib.Path("/proc/stat").read_text().split()[8]) / os.sysconf("SC_CLK_TCK")


def realtime_minute(bench, period_us):
    """A minute of `practical_rigid`, and what cyclictest saw in the same seconds. Rows of a table."""
    with tempfile.TemporaryDirectory() as out:
        stolen = stolen_s()
        beside = subprocess.Popen(
            ["cyclictest", "--quiet", "--mlockall", "--priority=80", f"--interval={period_us}", "--duration=60",
             "--histogram=100000", f"--json={out}/cyclictest"], stdout=subprocess.DEVNULL)
        run = subprocess.run(
            [bench.build / "bin/tachless", "run", "scenarios/practical_rigid.yaml", "--mode", "realtime", "--set",
             f"loop.period_s={period_us * 1e-6!r}", "--duration", "60", "--isolate", "--quiet", "--json",
             "--any-verdict", "--out", f"{out}/run"], cwd=bench.root, text=True, capture_output=True)
        beside.wait()
        stolen = stolen_s() - stolen
        if not run.stdout:
            sys.exit(f"bench/run: {run.stderr.strip()}")
        summary = json.loads(run.stdout)
        histogram = json.loads(pathlib.Path(f"{out}/cyclictest").read_text())["thread"]["0"]["histogram"]
    rate = f"{1000 / period_us:g} kHz"
    rows = [f"{rate}: {name} [µs] | " + " | ".join(f"{value:.0f}" for value in values) for name, values in (
        *((name, [summary[key][q] for q in ("p50", "p99", "p999", "max")])
          for name, key in (("command age", "command_age_us"), ("wake-up jitter", "wake_up_jitter_us"))),
        ("`cyclictest`", quantiles({int(us): times for us, times in histogram.items()})))]
    return rows, (f"{rate} | {summary['ticks']} | {summary['missed_deadlines']} | {summary['missed_commands']} | "
                  f"{summary['longest_command_miss']} | {summary['log']['gaps']} | {stolen:.2f} | "
                  f"{summary['fault'] or 'none'}")


def realtime(bench):
    """Two tables: latencies, and what was missed."""
    if not shutil.which("cyclictest"):
        return "Not measured: there is no `cyclictest` (Debian: rt-tests)."
    latencies, counts = [], []
    for _ in range(bench.rounds):
        for period_us in (1000, 500):
            rows, count = realtime_minute(bench, period_us)
            latencies += rows
            counts.append(count)
            print(f"  {count}", file=sys.stderr)
    lines = lambda rows: "\n".join(f"| {row} |" for row in rows)
    return "\n".join([
        "| each minute | p50 | p99 | p99.9 | longest |", "|---|---|---|---|---|", lines(latencies), "",
        "| | ticks | deadlines missed | commands missed | most in a row | gaps in the log | "
        "taken by the host [s] | protective stop |", "|---" * 8 + "|", lines(counts)])
