"""Velocity-free robot control from Python.

The laws, the plant, the protocol and the mechanics are those of the tachless programs: this package is a door to
them and computes nothing itself. Angles are in rad, lengths in m, torques in N m (N on prismatic joints).

    run_controller(f)        your law as the controller of a run
    simulate(scenario)       the closed loop in this process, as arrays
    read(log)                a recorded run, as arrays
    Robot(urdf)              mechanics: inertia matrix, inverse and forward dynamics, poses
    Error                    what goes wrong, in the words of the programs; its code is their exit code
"""

from __future__ import annotations

import json
import os
import sys
from collections.abc import Callable, Mapping, Sequence
from typing import Any, Optional, Union

import numpy as np
from numpy.typing import ArrayLike, NDArray

from . import _tachless
from ._tachless import Error, Measurement, Reference

__version__: str = _tachless.version
__all__ = ["Error", "Measurement", "Reference", "Robot", "Run", "read", "run_controller", "simulate"]

Path = Union[str, "os.PathLike[str]"]
Law = Callable[[int, float, Measurement, Reference], ArrayLike]


def _settings(values: Mapping[str, Any]) -> list[str]:
    """'key=value' of each, the value as YAML (JSON is YAML)."""

    def plain(value: Any) -> Any:
        if isinstance(value, (np.ndarray, np.generic)):
            return value.tolist()
        raise TypeError(f"{value!r} cannot be a scenario's value")

    return [f"{key}={json.dumps(value, default=plain)}" for key, value in values.items()]


class Robot:
    """The mechanics of a robot, read from a URDF file.

    Args:
        urdf: path of the file.
        gravity: m/s², along -z of the world.
        locked: joints held at a position and no joints of the robot any more, {name: rad or m}.
        base_rpy, base_xyz: where the root link is fixed in the world, rad and m.
        check_inertia: "refuse" bodies whose inertia no body can have, or "warn".

    Raises:
        Error: the file is no robot; the message names the file, the element and the remedy.

    n is the number of joints; q, v, a, tau are n numbers each.
    """

    def __init__(self, urdf: Path, *, gravity: float = 9.81, locked: Optional[Mapping[str, float]] = None,
                 base_rpy: Sequence[float] = (0, 0, 0), base_xyz: Sequence[float] = (0, 0, 0),
                 check_inertia: str = "refuse") -> None:
        self._robot = _tachless.Robot(
            os.fspath(urdf),
            _settings({"robot.check_inertia": check_inertia,
                       "robot.base": {"rpy": list(base_rpy), "xyz": list(base_xyz)},
                       **({"robot.locked": dict(locked)} if locked else {})}))
        self._robot.set_gravity(gravity)

    @property
    def num_joints(self) -> int:
        """n."""
        return self._robot.num_joints

    @property
    def joints(self) -> list[str]:
        """Names of the joints, in the order of q."""
        return self._robot.joints

    @property
    def links(self) -> list[str]:
        """Names of the links, for pose()."""
        return self._robot.links

    @property
    def warnings(self) -> list[str]:
        """What was read with a doubt."""
        return self._robot.warnings

    @property
    def lower(self) -> NDArray[np.float64]:
        """Lower limits of q, rad or m; -inf: none."""
        return self._robot.lower

    @property
    def upper(self) -> NDArray[np.float64]:
        """Upper limits of q, rad or m; inf: none."""
        return self._robot.upper

    @property
    def effort_limit(self) -> NDArray[np.float64]:
        """N m or N; inf: none."""
        return self._robot.effort_limit

    @property
    def velocity_limit(self) -> NDArray[np.float64]:
        """rad/s or m/s; inf: none."""
        return self._robot.velocity_limit

    def M(self, q: ArrayLike) -> NDArray[np.float64]:
        """Inertia matrix (n, n), kg m²; without motors' rotors."""
        return self._robot.M(q)

    def C(self, q: ArrayLike, v: ArrayLike) -> NDArray[np.float64]:
        """Coriolis matrix (n, n) of Christoffel's symbols: Mdot - 2 C is skew-symmetric."""
        return self._robot.C(q, v)

    def g(self, q: ArrayLike) -> NDArray[np.float64]:
        """Torque (n,) that holds the robot still against gravity."""
        return self._robot.g(q)

    def ID(self, q: ArrayLike, v: ArrayLike, a: ArrayLike) -> NDArray[np.float64]:
        """Inverse dynamics: M(q) a + C(q, v) v + g(q), (n,)."""
        return self._robot.ID(q, v, a)

    def FD(self, q: ArrayLike, v: ArrayLike, tau: ArrayLike) -> NDArray[np.float64]:
        """Forward dynamics: the acceleration (n,) under the torque tau."""
        return self._robot.FD(q, v, tau)

    def pose(self, link: str, q: ArrayLike) -> NDArray[np.float64]:
        """The link's frame in the root link's, as a homogeneous matrix (4, 4)."""
        return self._robot.pose(link, q)


class Run:
    """A run, simulated or recorded: run["q"] is an array (ticks, joints), run.t its times.

    A quantity that a tick lacks (lost in realtime) is NaN. names tells which quantities there are:
    true state q, v; reference q_ref, v_ref, ...; tau; the law's signals; what was measured, ..._measured.
    """

    def __init__(self, recorded: _tachless.Recorded) -> None:
        self._recorded = recorded

    @property
    def names(self) -> list[str]:
        """The quantities of this run."""
        return self._recorded.names()

    @property
    def joints(self) -> list[str]:
        """Names of the joints, in the order of the columns."""
        return self._recorded.joints

    @property
    def scenario(self) -> str:
        """Name of the scenario."""
        return self._recorded.scenario

    @property
    def law(self) -> str:
        """Name of the control law."""
        return self._recorded.law

    @property
    def text(self) -> str:
        """The scenario in YAML, with what was set."""
        return self._recorded.text

    @property
    def run_id(self) -> int:
        """Number of the run; 0 of a simulated one."""
        return self._recorded.run

    @property
    def period_s(self) -> float:
        """Length of a tick, s."""
        return self._recorded.period_s

    @property
    def ticks(self) -> NDArray[np.int64]:
        """Numbers of the ticks, (ticks,)."""
        return self._recorded.ticks()

    @property
    def t(self) -> NDArray[np.float64]:
        """Times of the ticks, s, (ticks,)."""
        return self._recorded.time()

    def __getitem__(self, name: str) -> NDArray[np.float64]:
        return self._recorded.array(name)

    def __contains__(self, name: object) -> bool:
        return name in self.names

    def units(self, name: str) -> list[str]:
        """Unit of each column of run[name], as in exports: "rad", "rad_per_s", "Nm", "1"."""
        return self._recorded.units(name)

    def description(self, name: str) -> str:
        """What run[name] is."""
        return self._recorded.description(name)

    def __repr__(self) -> str:
        return f"<tachless.Run {self.scenario}, {self.law}, {len(self.ticks)} ticks: {', '.join(self.names)}>"


def _name_of(f: Law, name: Optional[str]) -> str:
    return name or getattr(f, "__name__", None) or type(f).__name__


def simulate(scenario: Path, *, controller: Optional[Law] = None, name: Optional[str] = None,
             **overrides: Any) -> Run:
    """The closed loop of a scenario in this process: what a lock-step run logs, to the last bit.

    Args:
        scenario: path of the YAML file.
        controller: a law as for run_controller, in place of the scenario's.
        name: what the controller is called; default: the name of the function.
        overrides: values of the scenario by key, simulate(file, **{"controller.gains.kp": [400, 300]}).

    Raises:
        Error: the scenario is not valid (code 2), or a torque or state is not finite (code 5).
        KeyboardInterrupt: Ctrl-C, in the main thread.

    Other threads of Python run on meanwhile; several simulations may run at once. Between processes go the arrays of
    a Run, not the Run.
    """
    return Run(_tachless.simulate(os.fspath(scenario), _settings(overrides), controller,
                                  "" if controller is None else _name_of(controller, name)))


def read(log: Path, *, run_id: int = 0) -> Run:
    """The run that a log holds.

    Args:
        log: path of the log, or of a run's directory.
        run_id: which run, where the log holds several; default: the first.

    Raises:
        Error: the file is no log that can be read (code 2).
    """
    return Run(_tachless.read(os.fspath(log), run_id))


def run_controller(f: Law, scenario: Optional[Path] = None, *, name: Optional[str] = None,
                   argv: Optional[Sequence[str]] = None) -> None:
    """Makes this process the controller of a run, with the law f; returns when the run is over.

    f(k, t, measurement, reference) -> torque is called once per tick k, at the time t in s, with numpy arrays:
    measurement.q, .v, .theta, .thetadot (None: not measured), reference.q, .v, .a, .jerk, .snap. It returns one
    number per joint. What it remembers it keeps itself; where it has a method reset(), that is called before the first
    tick, and again where a gap in realtime is too long to be stepped over.

    Args:
        f: the law.
        scenario: path of the YAML file, where the command line names none.
        name: what the law is called in logs and reports; default: the name of the function.
        argv: command line, as of tachless-controller; default: sys.argv.

    Raises:
        SystemExit: the run did not end well; the code is that of the programs, and stderr says why.
    """
    words = list(sys.argv if argv is None else argv)
    if scenario is not None and not any(not word.startswith("-") for word in words[1:2]):
        words.insert(1, os.fspath(scenario))
    code = _tachless.run_controller(words, f, _name_of(f, name))
    if code != 0:
        raise SystemExit(code)
