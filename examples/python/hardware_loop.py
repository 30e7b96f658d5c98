"""The certified law in a loop with an arm of your own: an object with read(), send(torques) and brake()."""

import time


def control(arm, law, seconds):
    """Follows the scenario's reference. Ticks that were missed or overslept are left out; the law steps over them."""
    begin, tick = time.monotonic(), 0
    try:
        while tick * law.period_s < seconds:
            q = arm.read()  # None: no reading
            if q is not None:
                arm.send(law.step(q, tick=tick))
            passed = (time.monotonic() - begin) / law.period_s
            tick = max(tick + 1, int(passed))
            time.sleep(max(0.0, begin + tick * law.period_s - time.monotonic()))
    finally:
        arm.brake()
