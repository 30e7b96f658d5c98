"""What is in a log: its quantities with their units, and the largest error of each joint.

python3 examples/python/read_log.py out/paper_rigid
"""

import sys

import numpy as np
import tachless

run = tachless.read(sys.argv[1])
print(run)
for name in run.names:
    print(f"{name:24} {run.units(name)[0]:12} {run.description(name)}")
error = run["q"] - run["q_ref"]
for joint, name in enumerate(run.joints):
    k = np.argmax(np.abs(error[:, joint]))
    print(f"{name}: largest error {error[k, joint]:.3e} rad at {run.t[k]:.4f} s")
