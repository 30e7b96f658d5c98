"""The certified law in a loop of mj_step: python3 mujoco_loop.py SCENARIO ROBOT.urdf TICKS"""

import sys

import mujoco
import numpy as np
import tachless

law = tachless.Law(sys.argv[1])
print(law.certificate)
model = mujoco.MjModel.from_xml_path(sys.argv[2])
substeps = 20
model.opt.timestep = law.period_s / substeps  # MuJoCo's steps within one tick
data = mujoco.MjData(model)
coming, worst = np.zeros(model.nv), 0.0  # one tick of delay, as loop.command_delay says
for tick in range(int(sys.argv[3])):
    tau = law.step(data.qpos)
    worst = max(worst, abs(data.qpos - law.planned(tick)[0]).max())
    data.qfrc_applied[:], coming = coming, tau
    mujoco.mj_step(model, data, nstep=substeps)
print(f"largest error {worst:.2e} rad")
