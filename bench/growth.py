"""How figures grow: with joints, with the length of a run, with robots on a bus, with runs at a time.
For bench/run."""

import concurrent.futures
import json
import os
import pathlib
import statistics
import subprocess
import sys
import tempfile

JOINTS = (2, 4, 8, 16, 32, 64)
LENGTHS = (10_000, 100_000, 1_000_000, 10_000_000)
MANY = (1, 2, 4, 8)


def chain(joints):
    """URDF: a serial arm of `joints` links, 2 m and 20 kg together, axes y and z by turns."""
    length, mass = 2 / joints, 20 / joints
    inertia = mass * length**2 / 12 + 1e-4
    parts = ['<robot name="chain"><link name="l0"/>']
    for i in range(1, joints + 1):
        axis = "0 1 0" if i % 2 else "0 0 1"
        parts.append(
            f'<joint name="j{i}" type="continuous"><parent link="l{i - 1}"/><child link="l{i}"/>'
            f'<origin xyz="{length if i > 1 else 0} 0 0"/><axis xyz="{axis}"/></joint>'
            f'<link name="l{i}"><inertial><origin xyz="{length / 2} 0 0"/><mass value="{mass}"/>'
            f'<inertia ixx="{inertia}" iyy="{inertia}" izz="{inertia}" ixy="0" ixz="0" iyz="0"/>'
            '</inertial></link>')
    return "".join(parts) + "</robot>"


def scenario(folder, joints, name="chain"):
    """A chain with rotors, which keep it as easy to hold with many links as with few."""
    (folder / f"chain{joints}.urdf").write_text(chain(joints))
    path = folder / f"{name}.yaml"
    path.write_text(f"""name: {name}
robot: {{name: {name}, urdf: chain{joints}.urdf, joints: {{rigid: {{rotor_inertia_kgm2: 2}}}}}}
plant: {{integrator: {{method: runge_kutta_merson, accuracy: 1.0e-8}}}}
reference: {{sinusoid: {{amplitude_rad: 0.1, frequency_hz: 0.5}}}}
controller:
  law: numerical_difference   # a law for whose report no Lyapunov function is searched
  gains: {{kp: 4000, kd: 400, samples: 2}}
loop: {{mode: lockstep, period_s: 1.0e-3, duration_s: 1.0}}
""")
    return path


def run(bench, out, paths, ticks, *options, period=1e-3):
    """Summaries by robot, and the most memory of the process [MB]. Raises when the run fails."""
    command = [bench.build / "bin/tachless", "run", *paths, "--quiet", "--json", "--any-verdict",
               "--force", "--out", out, "--duration", repr(ticks * period), *options]
    with tempfile.TemporaryFile("w+") as stdout, tempfile.TemporaryFile("w+") as stderr:
        program = subprocess.Popen([str(word) for word in command], stdout=stdout, stderr=stderr)
        _, status, usage = os.wait4(program.pid, 0)
        program.returncode = os.waitstatus_to_exitcode(status)
        stdout.seek(0), stderr.seek(0)
        if program.returncode != 0:
            raise SystemExit(f"bench/run: {' '.join(map(str, command))}: {stderr.read()}")
        return json.load(stdout), usage.ru_maxrss / 1024


def rate(summary):
    return summary["ticks"] / summary["wall_s"]


def by_joints(bench, folder):
    for joints in JOINTS:
        path, out = scenario(folder, joints), folder / "out"
        ticks = max(1000, 40_000 // joints)
        row = [joints]
        for mechanics in ("simbody", "native"):
            which = ("--set", f"plant.mechanics={mechanics}")
            row.append(rate(run(bench, out, [path], ticks // 4, "--isolate", *which)[0]))
            summary, memory = run(bench, out, [path], ticks, "--in-process", *which)
            row.append(rate(summary))
            peer = json.loads(bench.output(bench.build / "bench/loop_peers", "c", path, *which,
                                           "--ticks", ticks // 10))
            row.append(peer["step_us"])
        row += [memory, (out / "lcmlog").stat().st_size / ticks]
        yield row


def by_length(bench, folder):
    path = bench.root / "scenarios/paper_rigid.yaml"
    for ticks in LENGTHS:
        out = folder / "out"
        summary, memory = run(bench, out, [path], ticks, "--in-process", "--set",
                              "plant.mechanics=native", period=5e-5)
        size = (out / "lcmlog").stat().st_size
        (out / "lcmlog").unlink()
        yield [ticks, rate(summary), memory, size / 1e6]


def by_robots(bench, folder):
    for robots in MANY:
        paths = [scenario(folder, 2, f"r{i}") for i in range(robots)]

        def of_all():
            summaries = run(bench, folder / "out", paths, 16_000 // robots, "--isolate", "--set",
                            "plant.mechanics=native")[0]
            return sum(map(rate, summaries.values() if robots > 1 else [summaries]))
        total = statistics.median(of_all() for _ in range(3))
        yield [robots, total / robots, total]


def by_runs(bench, folder):
    path = scenario(folder, 2)
    for runs in MANY:
        row = [runs]
        for where, ticks in (("--isolate", 16_000 // runs), ("--in-process", 100_000)):

            def of_all():
                with concurrent.futures.ThreadPoolExecutor(runs) as pool:
                    each = [pool.submit(run, bench, folder / f"out{i}", [path], ticks, where, "--set",
                                        "plant.mechanics=native") for i in range(runs)]
                    return sum(rate(future.result()[0]) for future in each)
            row.append(statistics.median(of_all() for _ in range(3)))
        yield row


TABLES = [
    ("Joints of a serial chain (generated: 2 m, 20 kg, rotors of 2 kg m², 1 kHz): ticks per second of "
     "four processes and of one, the plant's step alone; memory and log of the run in one process",
     ["joints", "Simbody, four", "in one", "step [µs]", "native, four", "in one", "step [µs]",
      "memory [MB]", "log per tick [B]"], by_joints),
    ("Length of a run (`paper_rigid`, native, in one process; the memory is the most until its report "
     "is written)", ["ticks", "ticks per second", "memory [MB]", "log [MB]"], by_length),
    ("Robots on one bus (chains of two joints, native, four processes each, one command; the median of "
     "three)",
     ["robots", "ticks per second of each", "of all"], by_robots),
    ("Runs at a time (chains of two joints, native, a command each; the median of three)",
     ["runs", "ticks per second of all, four processes each", "in one process each"], by_runs),
]

PLOT = """set terminal svg size 900,620 font 'sans,11' background rgb 'white'
set output '{svg}'
set multiplot layout 2,2
set grid
set key top right
set logscale xy
set xlabel 'joints'; set ylabel 'ticks per second'; set xtics (2, 4, 8, 16, 32, 64)
plot '{d}/0' u 1:6 w lp t 'native, one process', '' u 1:5 w lp t 'native, four', \\
  '' u 1:3 w lp t 'Simbody, one process', '' u 1:2 w lp t 'Simbody, four'
set xlabel 'joints'; set ylabel 'step [us]'; set key top left
plot '{d}/0' u 1:4 w lp t 'Simbody', '' u 1:7 w lp t 'native'
set xlabel 'ticks of a run'; set ylabel 'MB'; set xtics auto; set format x '10^{{%T}}'
plot '{d}/1' u 1:4 w lp t 'log', '' u 1:3 w lp t 'memory'
unset logscale; unset format; set yrange [0:]; set xtics (1, 2, 4, 8); set key bottom right
set xlabel 'robots on a bus, runs at a time'; set ylabel 'ticks per second of all'
plot '{d}/2' u 1:3 w lp t 'robots on one bus', '{d}/3' u 1:2 w lp t 'runs at a time'
"""


def growth(bench, svg):
    """Growth. Draws `svg`."""
    parts = []
    with tempfile.TemporaryDirectory() as name:
        folder = pathlib.Path(name)
        for i, (title, head, measure) in enumerate(TABLES):
            rows = []
            for row in measure(bench, folder):
                print(f"  {title[:12]}: {row}", file=sys.stderr)
                rows.append(row)
            (folder / str(i)).write_text("".join(" ".join(map(str, row)) + "\n" for row in rows))
            lines = [f"| {' | '.join(head)} |", "|" + "---|" * len(head)]
            lines += [f"| {' | '.join(f'{x:,.0f}' if x >= 20 or x == int(x) else f'{x:.1f}' for x in row)} |"
                      for row in rows]
            parts.append(f"{title}:\n\n" + "\n".join(lines))
        (folder / "plot").write_text(PLOT.format(svg=svg, d=folder))
        bench.output("gnuplot", folder / "plot")
    return "\n\n".join(parts)
