"""The Promela models of the protocol, checked by Spin: model_test.py PROGRAM_WITH_THE_TRACES

Each model has to be searched to its end without an error; each mutant, with one rule broken, has to have one.
Traces of simulated runs of the implementation (tests/core/session/run_test.cpp) have to be runs of the tick model,
and changed ones must not be.
"""

import json
import os
import re
import shutil
import subprocess
import sys
import tempfile
import unittest

HERE = os.path.dirname(os.path.abspath(__file__))
# Bounds on memory [MB] and depth of a search; the largest search takes 0.3 GB and 3000 steps.
BOUNDS = {"memory": 2000, "depth": 200000}


def check(model, defines, trace=None, to_its_end=False):
    """Spin's report of a search that ends at the first error. Optimised code pays for searches to their end alone: to
    compile it takes longer than to find an error."""
    with tempfile.TemporaryDirectory() as folder:

        def run(*command):
            done = subprocess.run(command, cwd=folder, text=True, stdout=subprocess.PIPE, stderr=subprocess.STDOUT)
            if done.returncode != 0:
                raise AssertionError(f"{' '.join(command)}: {done.stdout}")
            return done.stdout

        if trace is not None:
            with open(os.path.join(folder, "trace"), "w") as file:
                file.write(f"#define LEN {len(trace)}\nint events[LEN] = {{{', '.join(map(str, trace))}}};\n")
            defines = [*defines, "TRACE"]
        shutil.copy(os.path.join(HERE, model), folder)
        run("spin", "-a", *(f"-D{each}" for each in defines), model)
        run("gcc", "-O1" if to_its_end else "-O0", "-w", "-DSAFETY", "-DCOLLAPSE", "-DVECTORSZ=32768",
            f"-DMEMLIM={BOUNDS['memory']}", "-o", "pan", "pan.c")
        return run("./pan", "-w22", f"-m{BOUNDS['depth']}", *(["-E"] if trace is not None else []))


def error_in(report):
    """The error, "" if there is none. A search that was cut off is a failure."""
    if "max search depth too small" in report or "Search not completed" in report and "errors: 0" in report:
        raise AssertionError("the search was cut off: " + report)
    found = re.search(r"pan:1: (.*) \(at depth", report)
    if (found is None) != ("errors: 0" in report):
        raise AssertionError(report)
    return found.group(1) if found else ""


class Ticks(unittest.TestCase):
    def test_runs_end_well_or_with_a_fault(self):
        self.assertEqual(error_in(check("ticks.pml", [], to_its_end=True)), "")

    def test_nor_does_a_forged_end_or_acknowledgement_end_a_run_well(self):
        self.assertEqual(error_in(check("ticks.pml", ["FORGED"], to_its_end=True)), "")
        self.assertIn("referred==2", error_in(check("ticks.pml", ["FORGED", "MUTANT=6"])))

    def test_each_broken_rule_is_an_error(self):
        no_end, too_early = "assertion violated (rounds<=20)", "status"
        errors = {1: "stepped>next", 2: no_end, 3: no_end, 4: no_end, 5: "written==2", 7: too_early, 8: no_end, 9: no_end,
                  10: "law==stepped"}
        for mutant, error in errors.items():
            with self.subTest(mutant=mutant):
                self.assertIn(error, error_in(check("ticks.pml", [f"MUTANT={mutant}"])))


class Traces(unittest.TestCase):
    program = ""

    def traces(self):
        with tempfile.TemporaryDirectory() as folder:
            output = os.path.join(folder, "out.json")
            subprocess.run([self.program, "--gtest_filter=ALockstepRun.GivesTracesForTheModel", f"--gtest_output=json:{output}"],
                           check=True, stdout=subprocess.DEVNULL)
            with open(output) as file:
                case = json.load(file)["testsuites"][0]["testsuite"][0]
        return [[int(event) for event in text.split()] for key, text in case.items() if key.startswith("trace_")]

    def accepted(self, trace):
        return "pos<" in error_in(check("ticks.pml", ["N=20", "W=48", "DEPTH=64", "INTERVAL=16"], trace))

    def test_the_implementation_is_followed(self):
        traces = self.traces()
        self.assertEqual(len(traces), 3)
        for trace in traces:
            self.assertGreater(len(trace), 200)
            self.assertTrue(self.accepted(trace))

    def test_a_changed_trace_is_refused(self):
        trace = self.traces()[0]
        middle = len(trace) // 2
        self.assertFalse(self.accepted([*trace[:middle], trace[middle] + 1, *trace[middle + 1:]]))  # another
                                                                                                    # count
        command = next(i for i, event in enumerate(trace) if event // 4096 == 8)
        self.assertFalse(self.accepted(trace[:command] + trace[command + 1:]))  # tick 1 without command 0
        self.assertFalse(self.accepted([trace[command], *trace]))  # a command that no process has sent


if __name__ == "__main__":
    Traces.program = sys.argv.pop(1)
    unittest.main(verbosity=2)
