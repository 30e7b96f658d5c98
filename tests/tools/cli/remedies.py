#!/usr/bin/env python3
"""remedies.py TACHLESS TREE: every remedy that a refused command prints is typed, and the command then passes.

Each case provokes a message that has "type: COMMAND" or "type OPTIONS". COMMAND is typed as printed; OPTIONS are added
to the command that printed them. Neither may be refused as bad usage (exit code 2).
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
UNSTABLE = ["run", PRACTICAL, "--in-process", "--duration", "0.1", "--any-outcome", "--set", "loop.period_s=0.01"]
CASES = [
    UNSTABLE,
    ["design", ARM, "--bandwidth", "2", "--write", "designed.yaml", "-q"],
    ["excite", PRACTICAL, "--duration", "5", "--write", "move.yaml", "-q"],
    ["run", PAPER, "--realtime", "--duration", "0.01", "--isolate", "--any-outcome"],
    ["run", ARM],
]
REMEDY = re.compile(r"(?:type:|type) (tachless [^\n;]*|--[^\n;]*)|[:;] (tachless design [^\n;]* --write [^\n;]*?) makes")


def run(words, folder):
    return subprocess.run([BINARY, *map(str, words)], cwd=folder, text=True, capture_output=True, timeout=120,
                          stdin=subprocess.DEVNULL)


failures = 0
with tempfile.TemporaryDirectory() as name:
    for number, words in enumerate(CASES):
        folder = pathlib.Path(name) / str(number)
        folder.mkdir()
        first = run(words, folder)
        said = first.stdout + first.stderr
        remedies = [match[1] or match[2] for match in REMEDY.finditer(said)]
        if not remedies:
            failures += 1
            print(f"{words}: no remedy (exit code {first.returncode}): {said}")
        for remedy in remedies:
            remedy = re.split(r" (?:for|\(|or )", remedy)[0].rstrip(".,")
            typed = shlex.split(remedy.replace("SCENARIO.yaml", "scenario.yaml"))
            if typed[0] == "tachless":
                again = typed[1:] + (["--in-process"] if typed[1] == "run" else [])
            else:
                again = [word for word in words if word != typed[0].replace("--mode", "--realtime")] + typed
            second = run(again, folder)
            if second.returncode == 2:
                failures += 1
                print(f"{words}: the remedy {remedy!r} is refused: {second.stderr}")
print("all remedies can be typed" if not failures else f"{failures} failures")
sys.exit(1 if failures else 0)
