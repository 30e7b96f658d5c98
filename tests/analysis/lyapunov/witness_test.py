#!/usr/bin/env python3
"""check_witness.py on what `tachless certify --witness` writes: witness_test.py TACHLESS SCENARIOS."""
import json
import re
import subprocess
import sys
import tempfile
import unittest
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[3] / "tools/cli/witness"))
from check_witness import Loop, check, checksum, require_is_of
from interval import Rejected

TACHLESS, SCENARIOS = sys.argv[1], Path(sys.argv[2])

URDF = """<robot name="pendulum"><link name="base"/>
<link name="rod"><inertial><origin xyz="0 0 -0.4"/><mass value="2"/>
<inertia ixx="0.1" iyy="0.1" izz="0.01" ixy="0" ixz="0" iyz="0"/></inertial></link>
<joint name="swing" type="continuous"><parent link="base"/><child link="rod"/><axis xyz="0 -1 0"/>
</joint></robot>"""
SCENARIO = """name: pendulum
robot: {name: arm, urdf: pendulum.urdf, joints: rigid}
plant:
  initial: {position_rad: [0.5], velocity_rad_per_s: [0]}
  encoder: {resolution_bits: 20}
  drive: {torque_limit_Nm: 2000, viscous_friction_Nms_per_rad: 0.1}
reference: {hold: {position_rad: [0.5]}}
controller:
  law: loria_ortega_rigid
  gains: {kp: [1500], kd: [40], a: [1000], b: [1000]}
  filter: tustin
loop: {mode: lockstep, period_s: 1.0e-3, duration_s: 1.0, command_delay: 1}
"""


def witness(scenario, error):
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "witness.json"
        subprocess.run([TACHLESS, "certify", scenario, "--witness", file, "--witness-error", error, "--quiet"],
                       check=True, stdout=subprocess.DEVNULL)
        return file.read_text(encoding="utf-8")


def one_joint(error):
    with tempfile.TemporaryDirectory() as folder:
        (Path(folder) / "pendulum.urdf").write_text(URDF, encoding="utf-8")
        file = Path(folder) / "pendulum.yaml"
        file.write_text(SCENARIO, encoding="utf-8")
        return witness(file, error)


def changed(right, **numbers):
    text = json.dumps({**right, **numbers, "checksum": ""}, indent=1)
    return json.dumps({**json.loads(text), "checksum": checksum(text)}, indent=1)


def scaled(numbers, factor):
    return [scaled(x, factor) for x in numbers] if isinstance(numbers, list) else numbers * factor


class Witness(unittest.TestCase):
    def refuse_changes(self, text, wrong):
        digits = [m.start() for m in re.finditer(r"\d", text)]
        for at in digits[:: max(1, len(digits) // 60)]:
            other = text[:at] + str((int(text[at]) + 1) % 10) + text[at + 1:]
            with self.assertRaises(Rejected, msg=f"digit {at}"):
                check(other)
        # False values have the right checksum. The boxes are few: refusals would take as long as
        # proofs.
        for key, value in wrong.items():
            with self.assertRaises(Rejected, msg=key):
                check(changed(json.loads(text), **{key: value, "boxes": 300}))

    def test_two_joints_at_one_kilohertz(self):
        text = witness(SCENARIOS / "practical_rigid.yaml", "0.3,0.6")
        require_is_of(Loop(json.loads(text)), SCENARIOS / "practical_rigid.yaml")
        loop, boxes = check(text)
        print("practical_rigid:", boxes, "boxes, from rest", loop.alone())
        self.assertTrue((loop.alone() >= [0.3, 0.6]).all())
        right = json.loads(text)
        self.refuse_changes(text, {"kp": [right["kp"][0], 0.0], "kd": scaled(right["kd"], 10), "period_s": 5e-3,
                                   "rho": 0.9, "gamma": 0.0, "M": scaled(right["M"], 0.3),
                                   "g": scaled(right["g"], 300), "L": scaled(right["L"], 0.05)})

    def test_one_joint(self):
        text = one_joint("0.5")
        loop, boxes = check(text)
        print("one joint:", boxes, "boxes, from rest", loop.alone())
        self.assertGreaterEqual(loop.alone()[0], 0.5)
        right = json.loads(text)
        check(changed(right))
        self.refuse_changes(text, {
            "kd": [10 * right["kd"][0]], "kp": [0.0], "phi": [-1.5], "period_s": 5e-3, "rho": 0.9, "gamma": 0.0,
            "quantum": [1e-2], "torque_limit": [100.0], "M": [[[0.05]], [[0.0]], [[0.0]]], "viscous": [-200.0],
            "L": scaled(right["L"], 0.05)})


    def test_malformed_and_vacuous_claims(self):
        forged = (Path(__file__).parent / "cases/forged_quantum.json").read_text(encoding="utf-8")
        with self.assertRaisesRegex(Rejected, "quantum is negative"):
            check(forged)
        right = json.loads(forged)
        right["quantum"] = [0.0]
        check(changed(right))
        for key, value, why in (("joints", 1.7, "joints is not the whole number"), ("joints", 3, "whole number 1 or 2"),
                                ("boxes", 1e3, "boxes is no whole number"), ("boxes", 0, "boxes is out of range"),
                                ("torque_limit", [-1.0], "torque_limit is not above 0"),
                                ("torque_limit", [0.0], "torque_limit is not above 0"),
                                ("viscous", [-0.1], "viscous is negative"), ("rho", 1.0, "rho, gamma or the period"),
                                ("gamma", 0.9, "rho \\+ gamma > 1")):
            with self.assertRaisesRegex(Rejected, why, msg=key):
                check(changed(right, **{key: value}))
        two = {**right, "joints": 2, "M": [[[2.0, 0.3], [0.2, 1.0]], [[0.0, 0.0]] * 2, [[0.0, 0.0]] * 2]}
        for key in ("q_ref", "kp", "kd", "phi", "beta", "viscous", "quantum", "torque_limit"):
            two[key] = right[key] * 2
        two["g"], two["L"] = right["g"] * 2, [[float(i == j) for j in range(8)] for i in range(8)]
        with self.assertRaisesRegex(Rejected, "M is not symmetric"):
            check(changed(two))

    def test_is_of_its_scenario(self):
        forged = json.loads((Path(__file__).parent / "cases/forged_quantum.json").read_text(encoding="utf-8"))
        text = changed({**forged, "quantum": [(1 + 1e-9) * 3.141592653589793 * 2.0 ** -20], "gamma": 0.0009})
        with tempfile.TemporaryDirectory() as folder:
            (Path(folder) / "pendulum.urdf").write_text(URDF, encoding="utf-8")
            file = Path(folder) / "pendulum.yaml"
            file.write_text(SCENARIO, encoding="utf-8")
            loop = Loop(json.loads(text))
            require_is_of(loop, file)
            for was, is_ in (("kp: [1500]", "kp: [1400]"), ("period_s: 1.0e-3", "period_s: 1.1e-3"),
                             ("filter: tustin", "filter: backward_euler"), ("bits: 20", "bits: 19"),
                             ("limit_Nm: 2000", "limit_Nm: 1900"), ("command_delay: 1", "command_delay: 0")):
                file.write_text(SCENARIO.replace(was, is_), encoding="utf-8")
                with self.assertRaises(Rejected, msg=is_):
                    require_is_of(loop, file)
            file.write_text(SCENARIO, encoding="utf-8")
            for was, is_ in (('mass value="2"', 'mass value="2.1"'), ("0 0 -0.4", "0 0 -0.41")):
                (Path(folder) / "pendulum.urdf").write_text(URDF.replace(was, is_), encoding="utf-8")
                with self.assertRaises(Rejected, msg=is_):
                    require_is_of(loop, file)


if __name__ == "__main__":
    unittest.main(argv=sys.argv[:1])
