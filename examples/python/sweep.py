"""How large does the tracking error get when the filter is slower? A simulation for each pole, and a plot.

python3 examples/python/sweep.py SCENARIO PLOT.svg
"""

import sys
from concurrent.futures import ThreadPoolExecutor

import matplotlib
import numpy as np
import tachless

matplotlib.use("svg")
from matplotlib import pyplot  # noqa: E402

scenario, plot = sys.argv[1:]
poles = [300, 500, 1000, 2000]


def error_with(pole):
    run = tachless.simulate(scenario, **{"controller.gains.a": pole, "controller.gains.b": pole, "loop.duration_s": 1})
    settled = run.t > 0.5
    return np.sqrt(np.mean((run["q"] - run["q_ref"])[settled] ** 2, axis=0)), run.joints


with ThreadPoolExecutor() as threads:  # the simulations run in parallel, because Python waits outside of them
    results = list(threads.map(error_with, poles))
for joint, name in enumerate(results[0][1]):
    pyplot.loglog(poles, [error[joint] for error, _ in results], "o-", label=name)
pyplot.xlabel("pole of the filter a = b [rad/s]")
pyplot.ylabel("rms position error [rad]")
pyplot.legend()
pyplot.savefig(plot, bbox_inches="tight")
for pole, (error, _) in zip(poles, results):
    print(pole, *(f"{each:.3e}" for each in error))
