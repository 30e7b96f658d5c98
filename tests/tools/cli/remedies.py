#!/usr/bin/env python3
"""remedies.py TACHLESS TREE: every remedy that a refused command prints is typed, and the command then passes.

A case provokes one message. REMEDIES says how each kind of remedy is typed: a command as printed, an option added to
the command that printed it, a name in the place of the wrong one. What is typed is never refused as bad usage (exit
code 2), and a message without a remedy fails.
"""
import pathlib
import re
import shlex
import subprocess
import sys
import tempfile

BINARY, TREE = (pathlib.Path(argument).resolve() for argument in sys.argv[1:3])
PAPER = TREE / "scenarios/paper_rigid.yaml"
PRACTICAL = TREE / "scenarios/practical_rigid.yaml"
ARM = TREE / "scenarios/robots/two_link.urdf"
SHORT = ["--in-process", "--duration", "0.1", "--any-outcome"]
RUN = ["run", PRACTICAL, *SHORT]
MADE = [[*RUN, "--out", "made"]]  # what has to be typed before
FRICTION = ["--set", "plant.drive.coulomb_friction_Nm=[50, 50]", "--set",
            "plant.initial.position_rad=[0.001, 0.001]", "--set", "reference={hold: {position_rad: [0, 0]}}"]
# The command that prints the remedy, and those before it.
CASES = [
    ([*RUN, "--set", "loop.period_s=0.01"], []),
    (["design", ARM, "--bandwidth", "2", "--write", "designed.yaml", "-q"], []),
    (["design", ARM, "--set", "controller.law=linear_adrc", "--write", "designed.yaml", "-q"], []),
    (["design", ARM, "--set", "controller.law=loria_ortega_adaptive", "--write", "designed.yaml", "-q"], []),
    (["excite", PRACTICAL, "--duration", "5", "--write", "move.yaml", "-q"], []),
    (["run", PAPER, "--realtime", "--duration", "0.01", "--isolate", "--any-outcome"], []),
    (["run", ARM], []),
    (["run", PRACTICAL, "--in-process", "--duration", "0.3", *FRICTION], []),
    ([*RUN, "--out", "made"], MADE),
    (["export", "made", "-o", "made.csv"], [*MADE, ["export", "made", "-o", "made.csv"]]),
    (["report", "made", "-o", "page.html"], [*MADE, ["report", "made", "-o", "page.html"]]),
    (["export", "made", "-o", "no/such folder/made.csv"], MADE),
    (["report", "made", "-o", "no/page.html"], MADE),
    (["info", ARM], []),
    (["info", PRACTICAL], []),
    (["report", PRACTICAL, "-o", "page.html"], []),
    (["replay", ARM], []),
    (["runn", PRACTICAL, *SHORT], []),
    (["certfy", PRACTICAL], []),
    (["laws", "loria_ortega_rigd"], []),
    (["certify", PRACTICAL, "--set", "controller.law=loria_ortega_rigd"], []),
    (["certify", PRACTICAL, "--set", "controller.gains={kpp: 100, kd: 20, a: 100, b: 100}"], []),
    (["certify", PRACTICAL, "--set", "loop.perod_s=0.001"], []),
    (["certify", PRACTICAL, "--set", "controller.period_s=0.001"], []),
    (["certify", PRACTICAL, "--set", "loop.duration_s=0.10001"], []),
    (["certify", PRACTICAL, "--periods"], []),
    (["sweep"], []),
    (["export", "made"], MADE),
]


def run(words, folder):
    return subprocess.run([BINARY, *map(str, words)], cwd=folder, text=True, capture_output=True, timeout=300,
                          stdin=subprocess.DEVNULL)


def typed(command, words, folder):
    """Types a command that was printed as a whole."""
    parts = shlex.split(re.split(r" (?:for|\(|or |makes|prints|to )", command)[0].rstrip(".,"))
    parts = [part.replace("SCENARIO.yaml", "scenario.yaml") for part in parts]
    if parts[0] == "tachless":
        return run(parts[1:] + (SHORT if parts[1] == "run" else []), folder)
    if parts[0].startswith("--"):
        return run([word for word in words if word != "--realtime"] + parts, folder)
    subprocess.run(parts, cwd=folder, check=True)
    return run(words, folder)


def added(option, words, folder):
    return run([*words, option], folder)


def renamed(right, words, folder):
    """Types the right name in the place of the wrong one: a verb, the value or the key of the last --set."""
    words = list(map(str, words))
    if "--set" not in words:
        words[0 if not words[0] == "laws" else 1] = right
    elif "=" in words[-1] and re.fullmatch(r"[\d.]+", right):
        words[-1] = words[-1].split("=")[0] + "=" + right
    elif words[-1].startswith("controller.law="):
        words[-1] = "controller.law=" + right
    elif "{" in words[-1]:
        words[-1] = words[-1].replace("kpp", right)
    else:
        words[-1] = right + "=" + words[-1].split("=")[1]
    return run(words, folder)


REMEDIES = [
    (r"(?:type:|type|with:|resume:) (tachless [^\n;]*|--[^\n;]*|mkdir [^\n;]*|chmod [^\n;]*)", typed),
    (r"[:;] (tachless (?:design|run|robot) [^\n;]*)", typed),
    (r"; see (tachless [^\n;]*--help)", typed),
    (r"(?:with|or) (--overwrite|--force)\b", added),
    (r"(--any-outcome) makes that no failure", added),
    (r"(?:did you mean|nearest known key is|known here:|nearest is|nearest known name is) ([\w.]*\w)", renamed),
]


def failures_of(words, before, folder):
    for command in before:
        done = run(command, folder)
        if done.returncode != 0:
            return [f"{command}: ends with {done.returncode}: {done.stderr}"]
    first = run(words, folder)
    said = first.stdout + first.stderr
    failures, remedies = [], 0
    for pattern, type_it in REMEDIES:
        for match in re.finditer(pattern, said):
            remedies += 1
            second = type_it(match[1], words, folder)
            if second.returncode == 2:
                failures.append(f"{words}: the remedy {match[1]!r} is refused: {second.stderr}")
    if remedies == 0:
        failures.append(f"{words}: no remedy (exit code {first.returncode}): {said}")
    return failures


found = []
with tempfile.TemporaryDirectory() as name:
    for number, (words, before) in enumerate(CASES):
        folder = pathlib.Path(name) / str(number)
        folder.mkdir()
        found += failures_of(words, before, folder)
print("\n".join(found) if found else "all remedies can be typed")
sys.exit(1 if found else 0)
