"""A stand-in for the names of MuJoCo that examples/python/mujoco_loop.py uses, by tachless.Robot and semi-implicit Euler."""

import numpy as np
import tachless


class MjModel:
    @staticmethod
    def from_xml_path(path):
        model = MjModel()
        model.robot = tachless.Robot(path)
        model.nv = model.robot.num_joints
        model.opt = type("Option", (), {"timestep": 0.002})()
        return model


class MjData:
    def __init__(self, model):
        self.qpos, self.qvel, self.qfrc_applied = np.zeros((3, model.nv))


def mj_step(model, data, nstep=1):
    for _ in range(nstep):
        data.qvel += model.opt.timestep * model.robot.FD(data.qpos, data.qvel, data.qfrc_applied)
        data.qpos += model.opt.timestep * data.qvel
