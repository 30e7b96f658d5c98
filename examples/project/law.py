"""A law of your own, from positions alone: tachless run arm.yaml --controller 'python3 law.py'"""

import numpy as np
import tachless

arm = tachless.Robot("arm.urdf")
kp, kd = np.array([70, 6.3]), np.array([5.5, 0.5])
pole, h = 250, 1e-3  # of the filter [rad/s]; period of arm.yaml [s]


class MyLaw:
    def reset(self):  # before the first tick
        self.e = None

    def __call__(self, k, t, measurement, reference):
        e = measurement.q - reference.q
        if self.e is None:
            self.e, self.nu = e, np.zeros_like(e)
        decay = np.exp(-pole * h)
        self.nu = decay * self.nu + (1 - decay) / h * (e - self.e)  # replaces the velocity error
        self.e = e
        return arm.ID(measurement.q, reference.v, reference.a) - kp * e - kd * self.nu


if __name__ == "__main__":
    tachless.run_controller(MyLaw())
