#!/usr/bin/env python3
"""run_cases.py TACHLESS [ID...]: gives files of other programs to tachless and compares what it says.

Each object of cases.json is a case:
  files    the files that the case adds to those of this folder: a text; or "like", another file, with each
           "replace" pair replaced once and the first column "times" a number; or bytes as "hex"
  command  the arguments of tachless
  exit     its exit code
  says     words of its output, in any order; never: words that its output does not have
  inertia_matrix   of `robot --json`
  at_1_s   the reference at 1 s in the log that `run` has left in the folder out

Where no xacro is installed, bin/xacro stands in for it.
"""
import csv
import json
import os
import pathlib
import shlex
import shutil
import subprocess
import sys
import tempfile

HERE = pathlib.Path(__file__).resolve().parent


def scaled(text, factor):
    first, *rows = text.splitlines()
    cells = [row.split(",", 1) for row in rows]
    return "\n".join([first, *(f"{float(time) * factor:g},{rest}" for time, rest in cells)]) + "\n"


def content(given):
    if isinstance(given, str):
        return given.encode()
    if "hex" in given:
        return bytes.fromhex(given["hex"])
    text = (HERE / given["like"]).read_text()
    for old, new in given.get("replace", []):
        if text.count(old) == 0:
            raise ValueError(f"{given['like']} has no {old!r}")
        text = text.replace(old, new, 1)
    return (scaled(text, given["times"]) if "times" in given else text).encode()


def tachless(words, folder):
    return subprocess.run([BINARY, *words], cwd=folder, text=True, capture_output=True, timeout=300,
                          stdin=subprocess.DEVNULL, env={**os.environ, "PATH": f"{os.environ['PATH']}:{HERE / 'bin'}"})


def reference_at_1_s(folder):
    table = tachless(["export", "out", "-o", "-"], folder).stdout.splitlines()
    row = next(row for row in csv.DictReader(table) if float(row["t_s"]) == 1)
    return [float(row[f"q_ref_{joint}_rad"]) for joint in ("j1", "j2")]


def differ(a, b):
    if isinstance(a, list):
        return len(a) != len(b) or any(map(differ, a, b))
    return abs(a - b) > 1e-9


def problems(case, folder):
    for name, given in case.get("files", {}).items():
        (folder / name).write_bytes(content(given))
    done = tachless(shlex.split(case["command"]), folder)
    said = done.stdout + done.stderr
    if done.returncode != case["exit"]:
        yield f"exit code {done.returncode}; expected: {case['exit']}: {said}"
        return
    for words in case.get("says", []):
        if words not in said:
            yield f"does not say {words!r}: {said}"
    for words in case.get("never", []):
        if words in said:
            yield f"says {words!r}: {said}"
    if "inertia_matrix" in case and differ(case["inertia_matrix"], json.loads(done.stdout)["inertia_matrix"]):
        yield f"another inertia matrix: {said}"
    if "at_1_s" in case and differ(case["at_1_s"], at := reference_at_1_s(folder)):
        yield f"the reference at 1 s is {at}; expected: {case['at_1_s']}"


BINARY = pathlib.Path(sys.argv[1]).resolve()
failures = 0
for case in json.loads((HERE / "cases.json").read_text()):
    if sys.argv[2:] and case["id"] not in sys.argv[2:]:
        continue
    with tempfile.TemporaryDirectory() as name:
        folder = pathlib.Path(name)
        for file in filter(pathlib.Path.is_file, HERE.iterdir()):
            shutil.copy(file, folder)
        for problem in problems(case, folder):
            failures += 1
            print(f"{case['id']}: {case['why']}\n  {problem}")
print("all cases as expected" if not failures else f"{failures} failures")
sys.exit(1 if failures else 0)
