"""The paper's law for rigid robots from positions alone, as the controller of scenarios/paper_rigid.yaml.

tachless run scenarios/paper_rigid.yaml --controller 'python3 examples/python/loria_ortega.py'
"""

import pathlib

import numpy as np
import tachless

here = pathlib.Path(__file__).resolve().parent
robots = next(p for p in (here / "../../scenarios/robots", pathlib.Path("/usr/share/tachless/scenarios/robots")) if p.exists())
arm = tachless.Robot(robots / "two_link.urdf")
kp, kd, a, b, h = np.array([5000, 6000]), np.array([7000, 8800]), 1000, 1000, 5e-5
memory = {}


def loria_ortega(k, t, measurement, reference):
    e = measurement.q - reference.q
    nu = np.zeros(2)
    if k > 0:  # the filter b p/(p + a), exact for an error that is linear between ticks
        nu = np.exp(-a * h) * memory["nu"] - b * np.expm1(-a * h) / (a * h) * (e - memory["e"])
    memory.update(e=e, nu=nu)
    return arm.ID(measurement.q, reference.v, reference.a) - kp * e - kd * nu


if __name__ == "__main__":
    tachless.run_controller(loria_ortega)
