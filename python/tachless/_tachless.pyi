from typing import Optional
import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

class Error(Exception):
    """What goes wrong, in the words of the programs."""
    code: int

class Measurement:
    q: Optional[Array]
    v: Optional[Array]
    theta: Optional[Array]
    thetadot: Optional[Array]

class Reference:
    q: Array
    v: Array
    a: Array
    jerk: Array
    snap: Array
