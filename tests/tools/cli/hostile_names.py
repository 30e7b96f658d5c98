#!/usr/bin/env python3
"""Files whose names have control characters: no command prints one of them.

hostile_names.py TACHLESS SCENARIOS    in a network of its own (tests/support/private_network.sh)
"""
import pathlib
import re
import shutil
import subprocess
import sys
import tempfile

NAME = "a\x1b]0;x\x07\x9b\nb"
CONTROL = re.compile("[\x00-\x09\x0b-\x1f\x7f-\x9f]")


def main():
    tachless, scenarios = pathlib.Path(sys.argv[1]).resolve(), pathlib.Path(sys.argv[2]).resolve()
    with tempfile.TemporaryDirectory() as folder:
        place = pathlib.Path(folder)
        shutil.copytree(scenarios / "robots", place / "robots")
        scenario, log = f"{NAME}.yaml", f"{NAME}-run/lcmlog"
        shutil.copy(scenarios / "practical_rigid.yaml", place / scenario)
        short = ["--set", "loop.duration_s=0.05"]
        vary = ["--vary", "loop.period_s=0.001,0.002", *short]
        commands = [
            ["run", scenario, "--in-process", "--any-outcome", "--out", f"{NAME}-run", *short],
            ["run", scenario, "--any-outcome", "--out", f"{NAME}-bus", *short],
            ["run", scenario, "--key-file", f"{NAME}.key"],
            ["run", scenario, "--controller", f"./{NAME}.py", *short],
            ["run", f"{NAME}-absent.yaml"],
            ["certify", scenario],
            ["robot", scenario],
            ["design", scenario, "--write", f"{NAME}-design.yaml"],
            ["excite", scenario, "--write", f"{NAME}-excite.yaml"],
            ["commission", scenario],
            ["info", log],
            ["replay", log],
            ["replay", log, "--set", "controller.gains.a=900", "--out", f"{NAME}-replay"],
            ["report", log, "-o", f"{NAME}.html"],
            ["export", log, "-o", f"{NAME}.csv"],
            ["identify", log, "--write", f"{NAME}-identify.yaml"],
            ["sweep", scenario, *vary, "--out", f"{NAME}-sweep"],
            ["sweep", f"{NAME}-sweep", "--status"],
            ["compare", scenario, *short, "--out", f"{NAME}-compare"],
            ["init", f"{NAME}-init"]]
        for command in commands:
            ended = subprocess.run([tachless, *command], cwd=place, stdin=subprocess.DEVNULL, stdout=subprocess.PIPE,
                                   stderr=subprocess.STDOUT)
            said = ended.stdout.decode("utf-8", "replace")
            assert ended.returncode in range(0, 6), (command, ended.returncode, said)
            assert "internal error" not in said, (command, said)
            assert not CONTROL.search(said), (command, said)


if __name__ == "__main__":
    main()
