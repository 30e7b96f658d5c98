#!/usr/bin/env python3
"""Compares laws for flexible joints at one modulus margin, by the shipped programs, and prints a Markdown table.

  bench/flexible_positions.py [--tachless PROGRAM] [--differenced PROGRAM] [--figure FILE.svg] [--in-process]

Each row is a `tachless certify` and five `tachless run` of scenarios/practical_flexible_positions.yaml, over the bus. The gains
are those of docs/studies/study_flexible_positions.md. Needs the program slotine_li_flexible_differenced (ninja target).
"""

import argparse
import csv
import json
import math
import pathlib
import subprocess
import tempfile

ROOT = pathlib.Path(__file__).resolve().parent.parent
SCENARIO = ROOT / "scenarios/practical_flexible_positions.yaml"
SPRINGS = "stiffness_Nm_per_rad: [10000, 10000], rotor_inertia_kgm2: [0.1, 0.1]"

# Label, law, and its gains by ticks of delay.
LAWS = [
    ("`flexible_position`, shipped", "flexible_position", {
        1: "{kp1: [46000, 2300], kd1: [845, 53.6], a1: 425, b1: 425, beta: [1.10, 1.25], kd2: [27.2, 16.4], a2: 2360, b2: 2360}"}),
    ("`flexible_position`, other gains", "flexible_position", {
        0: "{kp1: [55000, 3900], kd1: [1100, 55], a1: 500, b1: 500, beta: 1, kd2: [34, 26], a2: 520, b2: 520}",
        1: "{kp1: [46000, 2300], kd1: [975, 45], a1: 1000, b1: 1000, beta: 0.95, kd2: [23, 23], a2: 1000, b2: 1000}"}),
    ("`loria_ortega_flexible`, velocity exact", "loria_ortega_flexible", {
        0: "{kp1: [146000, 6600], kd1: [1600, 61], a1: 323, b1: 323, kp2: [16, 157], kd2: [20, 36], a2: 1000, b2: 1000}",
        1: "{kp1: [70350, 3638], kd1: [1044, 60.2], a1: 244.7, b1: 244.7, kp2: [4.5, 7], kd2: [12.6, 18.9], a2: 21536, b2: 21536}"}),
    ("`slotine_li_flexible` by differences", "external", {
        0: "{lambda: 112, ks1: [1389, 93.9], ks2: [0.1565, 7.94]}",
        1: "{lambda: 37.2, ks1: [640, 33], ks2: [1.56, 1.42]}"}),
    ("`flexible_motor`", "flexible_motor", {
        0: "{kp: [1000, 100], kd: [57, 12], a: 980, b: 980}",
        1: "{kp: [170, 70], kd: [25, 6.5], a: 830, b: 830}"}),
]
PLANTS = {
    "exact": [],
    "0.5 kg": ["plant.payload={mass_kg: 0.5}"],
    "friction": ["robot.joints={flexible: {" + SPRINGS + ", motor_damping_Nms_per_rad: 1, motor_coulomb_friction_Nm: 2}}"],
}


def settings(law, gains, delay, more=()):
    text = [f"controller.law={law}", f"controller.gains={gains}", f"loop.command_delay={delay}", "plant.mechanics=native",
            "loop.duration_s=10", *more]
    if law == "external":
        text.append("controller.measurement=BOTH_POSITIONS")
    return [word for each in text for word in ("--set", each)]


class Study:
    def __init__(self, arguments, folder):
        self.tachless, self.differenced = arguments.tachless, arguments.differenced
        self.way = ["--in-process"] if arguments.in_process else []
        self.folder, self.runs = pathlib.Path(folder), 0

    def call(self, verb, law, words):
        controller = ["--controller", str(self.differenced)] if law == "external" else []
        command = [self.tachless, verb, str(SCENARIO), *controller, *words]
        done = subprocess.run([str(word) for word in command], text=True, capture_output=True)
        if done.returncode not in (0, 1):
            raise SystemExit(" ".join(map(str, command)) + "\n" + done.stderr)
        return done.stdout

    def loop(self, law, gains, delay):
        return json.loads(self.call("certify", law, ["--json", *settings(law, gains, delay)]))["sampled"]

    def run(self, law, gains, delay, more):
        """Returns errors and torques of the last quarter of a run, each a list of joints."""
        self.runs += 1
        out = self.folder / str(self.runs)
        self.call("run", law, ["-q", "--any-outcome", *self.way, "--out", out, *settings(law, gains, delay, more)])
        table = self.folder / f"{self.runs}.csv"
        subprocess.run([self.tachless, "export", str(out / "lcmlog"), "-o", str(table)], check=True, capture_output=True)
        rows = list(csv.DictReader(line for line in table.open() if not line.startswith("#")))
        rows = rows[3 * len(rows) // 4:]

        def of_joints(quantity, unit):
            return [[float(row[f"{quantity}_{joint}_{unit}"]) for row in rows] for joint in ("shoulder", "elbow")]

        pairs = zip(of_joints("q", "rad"), of_joints("q_ref", "rad"))
        return [max(abs(a - b) for a, b in zip(*joint)) for joint in pairs], of_joints("tau", "Nm")

    def row(self, law, gains, delay):
        loop = self.loop(law, gains, delay)
        errors, torques = {}, {}
        for name, more in PLANTS.items():
            errors[name], torques[name] = self.run(law, gains, delay, more)
        _, smooth = self.run(law, gains, delay, ["plant.encoder.resolution_bits=null"])
        noise = [math.sqrt(sum((a - b) ** 2 for a, b in zip(*joint)) / len(joint[0]))
                 for joint in zip(torques["exact"], smooth)]
        return {"decay": loop["decay_per_s"], "limit_ms": 1e3 * loop["limit_s"], "modulus": loop["margins"]["modulus"],
                "noise": noise, "errors": {name: max(each) for name, each in errors.items()}}


def figure(rows, file):
    """Writes decay over the torque's noise at the first joint, one mark a row."""
    def x(noise): return 70 + 200 * (math.log10(noise) + 2)
    def y(decay): return 300 - 3.4 * decay
    text = ['<svg xmlns="http://www.w3.org/2000/svg" width="860" height="350" font-family="sans-serif" font-size="12">',
            '<rect width="860" height="350" fill="white"/>']
    for noise in (0.01, 0.1, 1, 10):
        text.append(f'<path d="M{x(noise):.0f} 40V300" stroke="#ddd"/><text x="{x(noise):.0f}" y="316" '
                    f'text-anchor="middle">{noise:g}</text>')
    for decay in range(0, 80, 20):
        text.append(f'<path d="M70 {y(decay):.0f}H720" stroke="#ddd"/><text x="62" y="{y(decay) + 4:.0f}" '
                    f'text-anchor="end">{decay}</text>')
    text.append('<text x="370" y="338" text-anchor="middle">torque noise of 20-bit encoders, joint 1 [N m]</text>'
                '<text x="20" y="28">slowest mode [1/s]; full: one tick of delay, hollow: none</text>')
    colours = ["#0072b2", "#56b4e9", "#d55e00", "#009e73", "#777777"]
    for name, delay, row in rows:
        colour = colours[[law[0] for law in LAWS].index(name)]
        at, top = x(row["noise"][0]), y(row["decay"])
        text.append(f'<circle cx="{at:.1f}" cy="{top:.1f}" r="5" stroke="{colour}" stroke-width="2" '
                    f'fill="{colour if delay else "white"}"/>')
        if delay:
            left = "shipped" in name  # beside the mark of the other gains
            text.append(f'<text x="{at - 9 if left else at + 9:.0f}" y="{top + 4:.0f}" fill="{colour}" '
                        f'text-anchor="{"end" if left else "start"}">{name.replace("`", "")}</text>')
    file.write_text("\n".join([*text, "</svg>", ""]))


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--tachless", default=str(ROOT / "build/release/bin/tachless"))
    parser.add_argument("--differenced", default=str(ROOT / "build/release/bench/slotine_li_flexible_differenced"))
    parser.add_argument("--figure", type=pathlib.Path)
    parser.add_argument("--in-process", action="store_true")
    arguments = parser.parse_args()
    print("| law | delay [ticks] | decay [1/s] | largest period [ms] | modulus | torque noise [N m] | error [rad] | with 0.5 kg "
          "| with motor friction |\n|---|---|---|---|---|---|---|---|---|")
    rows = []
    with tempfile.TemporaryDirectory() as folder:
        study = Study(arguments, folder)
        for name, law, gains in LAWS:
            for delay in sorted(gains):
                row = study.row(law, gains[delay], delay)
                rows.append((name, delay, row))
                errors = " | ".join(f"{row['errors'][plant]:.1e}" for plant in PLANTS)
                print(f"| {name} | {delay} | {row['decay']:.1f} | {row['limit_ms']:.2f} | {row['modulus']:.2f} | "
                      f"{row['noise'][0]:.2g} / {row['noise'][1]:.2g} | {errors} |", flush=True)
    if arguments.figure:
        figure(rows, arguments.figure)


if __name__ == "__main__":
    main()
