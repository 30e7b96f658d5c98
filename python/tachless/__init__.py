"""Velocity-free robot control from Python.

The laws, the plant, the protocol and the mechanics are those of the tachless programs; this package calls
them and computes nothing itself. Angles are in rad, lengths in m, torques in N m (N on prismatic joints). ::

    run_controller(f)        your law as the controller of a run
    simulate(scenario)       the closed loop in this process, as arrays
    read(log)                a recorded run, as arrays
    certify, design, identify, sweep  what the commands of these names find, as objects
    linear(scenario)         the loop's map of one period, as matrices
    listen(channels)         the messages of a bus, as they come
    run.plot(), plot(run)    a picture of a run, by matplotlib
    Robot(urdf)              mechanics: inertia matrix, inverse and forward dynamics, poses
    Error                    an error of the programs: their message; its code is their exit code
"""

from __future__ import annotations

import contextlib
import csv
import dataclasses
import json
import os
import pathlib
import shutil
import subprocess
import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Any, Optional, Union

import numpy as np
from numpy.typing import ArrayLike

from . import _tachless
from ._tachless import Error, Measurement, Reference, Run

__version__: str = _tachless.version
__all__ = ["Error", "Linear", "Measurement", "Reference", "Result", "Robot", "Run", "certify", "design", "identify",
           "linear", "listen", "plot", "read", "run_controller", "simulate", "sweep"]

Path = Union[str, "os.PathLike[str]"]
Law = Callable[[int, float, Measurement, Reference], ArrayLike]


def _settings(values: Mapping[str, Any]) -> list[str]:
    """'key=value' of each, the value as YAML (JSON is YAML)."""

    def plain(value: Any) -> Any:
        if isinstance(value, (np.ndarray, np.generic)):
            return value.tolist()
        raise TypeError(f"{value!r} cannot be a scenario's value")

    return [f"{key}={json.dumps(value, default=plain)}" for key, value in values.items()]


class Robot(_tachless.Robot):
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
        super().__init__(
            _found(urdf),
            _settings({"robot.check_inertia": check_inertia,
                       "robot.base": {"rpy": list(base_rpy), "xyz": list(base_xyz)},
                       **({"robot.locked": dict(locked)} if locked else {})}), gravity)


def _name_of(f: Law, name: Optional[str]) -> str:
    return name or getattr(f, "__name__", None) or type(f).__name__


def simulate(scenario: Path, *, controller: Optional[Law] = None, name: Optional[str] = None,
             **overrides: Any) -> Run:
    """The closed loop of a scenario in this process: what a lock-step run logs, to the last bit.

    Args:
        scenario: path of the YAML file.
        controller: a law as for run_controller, in place of the scenario's.
        name: what the controller is called; default: the name of the function.
        overrides: values of the scenario by key, ``simulate(file, **{"controller.gains.kp": [400, 300]})``.

    Raises:
        Error: the scenario is not valid (code 2), or a torque or state is not finite (code 5).
        KeyboardInterrupt: Ctrl-C, in the main thread.

    Other threads of Python run on meanwhile; several simulations may run at once. Between processes go the arrays of
    a Run, not the Run.
    """
    return _tachless.simulate(_found(scenario), _settings(overrides), controller,
                              "" if controller is None else _name_of(controller, name))


def read(log: Path, *, run_id: int = 0) -> Run:
    """The run that a log holds.

    Args:
        log: path of the log, or of a run's directory.
        run_id: which run, where the log holds several; default: the first.

    Raises:
        Error: the file is no log that can be read (code 2).
    """
    return _tachless.read(os.fspath(log), run_id)


def run_controller(f: Law, scenario: Optional[Path] = None, *, name: Optional[str] = None,
                   argv: Optional[Sequence[str]] = None) -> None:
    """Makes this process the controller of a run, with the law f; returns when the run is over.

    f(k, t, measurement, reference) -> torque is called once per tick k, at the time t in s, with numpy arrays:
    measurement.q, .v, .theta, .thetadot (None: not measured), reference.q, .v, .a, .jerk, .snap. It returns one
    number per joint. What it remembers it keeps itself; where it has a method reset(), that is called before the first
    tick, and again where a gap in realtime is too long to be stepped over. A method set_gains(gains) is called before
    the run with the scenario's controller.gains, arrays by name; what it raises refuses them (code 2).

    Args:
        f: the law.
        scenario: path of the YAML file, where the command line does not begin with one.
        name: what the law is called in logs and reports; default: the name of the function.
        argv: command line, as of tachless-controller; default: sys.argv.

    Raises:
        SystemExit: the run did not end well; the code is that of the programs, and stderr says why.
    """
    words = list(sys.argv if argv is None else argv) or ["tachless-controller"]
    if scenario is not None and not any(not word.startswith("-") for word in words[1:2]):
        words.insert(1, os.fspath(scenario))
    code = _tachless.run_controller(words, f, _name_of(f, name))
    if code != 0:
        raise SystemExit(code)


class Result(dict):
    """What a command found: the fields of its --json, as items and as attributes; prints as the command does.

    messages is what the command wrote to stderr, objection says whether it objected (exit code 1).
    """

    messages: str = ""
    objection: bool = False

    def __getattr__(self, name: str) -> Any:
        try:
            return self[name]
        except KeyError:
            raise AttributeError(name) from None

    def __str__(self) -> str:
        return str(self["text"])

    __repr__ = __str__


def _error(message: str, code: int) -> Error:
    error = Error(message)
    error.code = code
    return error


def _program() -> str:
    """The tachless program: $TACHLESS, else that of this installation or build, else that of the PATH."""
    if named := os.environ.get("TACHLESS"):
        if not (program := shutil.which(named)):
            raise _error(f"TACHLESS is {named!r}: no such program", 2)
        return program
    here = pathlib.Path(__file__).resolve()
    for above in (2, 4):  # build/release/python/tachless; PREFIX/lib/python3/dist-packages/tachless
        if len(here.parents) > above and (found := here.parents[above] / "bin" / "tachless").is_file():
            return str(found)
    if not (program := shutil.which("tachless")):
        raise _error("no program tachless beside this package or in PATH; install it, or set TACHLESS to its path", 2)
    return program


def _found(file: Path) -> str:
    """A scenario or URDF as the programs find it: here, else by its path in the installation's scenarios."""
    name = os.fspath(file).removeprefix("scenarios/")
    with contextlib.suppress(Error):  # no program: the message is about the file, which is not here
        if not os.path.exists(file):
            folder = pathlib.Path(_program()).resolve().parent.parent / "share/tachless/scenarios"
            installed = folder / (name if pathlib.Path(name).suffix else name + ".yaml")
            return os.fspath(installed if os.path.exists(installed) else file)
    return os.fspath(file)


def _result(verb: str, words: Sequence[Any], overrides: Mapping[str, Any]) -> Result:
    command = [_program(), verb, *map(str, words), "--json", "--quiet"]
    for setting in _settings(overrides):
        command += ["--set", setting]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    if done.returncode not in (0, 1) or not done.stdout.startswith("{"):  # such as that of --help
        raise _error(done.stderr.strip().removeprefix("tachless: ") or
                     f"tachless {verb} has no result with these options; type them in a shell", done.returncode or 2)
    result = Result(json.loads(done.stdout))
    result.__dict__.update(messages=done.stderr, objection=done.returncode != 0)
    return result


def _options(values: Mapping[str, Any]) -> list[str]:
    """Options of a command: {"count_share": 0.02} is --count-share=0.02; a list has commas."""
    text = {key: ",".join(map(str, value)) if isinstance(value, (list, tuple, np.ndarray)) else str(value)
            for key, value in values.items() if value is not None}
    return [f"--{key.replace('_', '-')}={value}" for key, value in text.items()]


def certify(scenario: Path, controller: Optional[str] = None, full: bool = False, **overrides: Any) -> Result:
    """Is the scenario's loop stable, with what margins, from which errors: tachless certify.

    Args:
        controller: the program with the law, as typed in a shell: "python3 law.py".
        full: also search the nonlinear sampled loop and missed ticks, which takes seconds.

    Raises:
        Error: the scenario is not valid (code 2).
    """
    words = [scenario, *_options({"controller": controller}), *(["--full"] if full else [])]
    return _result("certify", words, overrides)


def design(robot: Path, *, write: Optional[Path] = None, overrides: Optional[Mapping[str, Any]] = None,
           **goal: Any) -> Result:
    """Gains for a scenario or a bare URDF: tachless design.

    Args:
        write: a file for the scenario with these gains.
        overrides: values of the scenario by key.
        goal: the command's options: settling, bandwidth, stiffness, rest_error, noise, margin, period, ...

    Raises:
        Error: no gains do (code 1), or the scenario or an option is not valid (code 2).
    """
    return _result("design", [robot, *_options({"write": write, **goal})], overrides or {})


def identify(*logs: Path, unknown: Union[str, Sequence[str]] = ("rotor", "viscous", "coulomb"),
             **options: Any) -> Result:
    """Rotor inertia, friction and payload from logs of runs: tachless identify, options as its (validate, write, force, ...).

    Raises:
        Error: a log that does not show them (code 2).
    """
    if options.get("all"):  # the command refuses --unknown beside it
        return _result("identify", [*logs, *_options(options)], {})
    names = [unknown] if isinstance(unknown, str) else list(unknown)
    return _result("identify", [*logs, *_options({"unknown": names, **options})], {})


def sweep(scenario: Path, vary: Optional[Mapping[str, Any]] = None, *, out: Optional[Path] = None,
          overrides: Optional[Mapping[str, Any]] = None, **options: Any) -> Result:
    """Many runs of a scenario with values varied, over all cores: tachless sweep.

    Args:
        vary: by key, as of --vary, values as a list or as text: {"controller.gains.kp*": "0.1:10:21:log"}.
        out: a directory for results.csv and index.html; default: out/sweep-NAME.
        overrides: values of the scenario by key.
        options: the command's options: random, seed, laws, bandwidth, colour, threads.

    Returns:
        What --json has, and table: the columns of results.csv by name, arrays (runs,); NaN where there is no number.

    Raises:
        Error: the scenario, a key or an option is not valid (code 2).
    """
    axes = [f"--vary={key}={values if isinstance(values, str) else ','.join(map(repr, np.asarray(values).tolist()))}"
            for key, values in (vary or {}).items()]
    result = _result("sweep", [scenario, *axes, *_options({"out": out, **options})], overrides or {})
    with open(os.path.join(result["directory"], "results.csv"), newline="", encoding="utf-8") as file:
        rows = zip(*csv.reader(file))
    result["table"] = {name: np.array(column if name in ("law", "outcome", "stopped") else [float(x or "nan") for x in column])
                       for name, *column in rows}
    return result


@dataclasses.dataclass(frozen=True, eq=False)
class Linear:
    """x[k+1] = A x[k] + B u[k], y[k] = C x[k] + D u[k], period h [s]: deviations from rest at a posture (n,).

    states names the entries of x, with units: q and v of the n links; theta and thetadot of flexible joints; a current loop's
    torques; the law's memory; with a delay of d ticks, encoder's latency included, the torques under way, tau[k-1] to tau[k-d],
    of which the last acts now. u (n,) is a torque added to the law's, under way like it. inputs and outputs name those of u, y.
    """

    A: np.ndarray
    B: np.ndarray
    C: np.ndarray
    D: np.ndarray
    h: float
    posture: np.ndarray
    states: list[str]
    inputs: list[str]
    outputs: list[str]


def linear(scenario: Path, posture: Optional[ArrayLike] = None, *, open_loop: bool = False, **overrides: Any) -> Linear:
    """The loop over one period, linearised about rest, its torque held: what certify examines.

    y is q, and the eigenvalues of A are the loop's modes. With open_loop the law's feedback is cut where its torque leaves,
    and y is that torque negated: A - B C is the closed map. Compensation of gravity stays closed.

    Args:
        posture: joint positions (n,), rad or m; default: where the reference begins.
        overrides: values of the scenario by key.

    Raises:
        Error: the scenario is not valid, or its law cannot be linearised (code 2).
    """
    return Linear(**_tachless.linear(_found(scenario), _settings(overrides), posture, open_loop))


def listen(*channels: str, lcm_url: Optional[str] = None, seconds: float = 1e9) -> Iterator[dict[str, Any]]:
    """The messages on a bus as they come: ``for m in listen("ARM_COMMAND"): print(m["tick"], m["torque"])``.

    A message has channel, type, utime [us], run, tick, and the fields of its .lcm file, lists as arrays. A key's tag is not
    verified. No run is held up: what is taken too slowly is lost, as gaps in tick show. Ctrl-C ends it.

    Args:
        channels: names, as in tachless watch; none: all.
        lcm_url: the bus; default: that of LCM_DEFAULT_URL, else that of the programs.
        seconds: it ends after that long without a message.

    Raises:
        Error: the bus cannot be joined (code 2).
    """
    bus = _tachless.Listener(channels, lcm_url or "")
    return ({name: np.array(value) if isinstance(value, list) else value for name, value in json.loads(text).items()}
            for text in iter(lambda: bus.take(min(seconds, 1e9)), ""))


def plot(run: Run, axes: Any = None) -> Any:
    """Position and reference, error and torque of each joint over time, by matplotlib; the figure.

    Args:
        axes: three axes of one figure; default: a new figure.

    Raises:
        ImportError: matplotlib is not installed.
    """
    import matplotlib.pyplot as pyplot  # pylint: disable=import-outside-toplevel

    if axes is None:
        _, axes = pyplot.subplots(3, sharex=True, figsize=(8, 8), layout="constrained")
    positions, errors, torques = axes
    for i, joint in enumerate(run.joints):
        line, = positions.plot(run.t, run["q"][:, i], label=joint)
        positions.plot(run.t, run["q_ref"][:, i], linestyle="--", color=line.get_color())
        errors.plot(run.t, run["q"][:, i] - run["q_ref"][:, i])
        torques.plot(run.t, run["tau"][:, i])
    unit, torque = (" or ".join(dict.fromkeys(run.units(name))) for name in ("q", "tau"))
    for axis, label in zip(axes, (f"q (reference: dashed) [{unit}]", f"error [{unit}]", f"torque [{torque}]")):
        axis.set_ylabel(label)
        axis.grid(True, alpha=0.3)
    positions.legend(loc="upper right")
    torques.set_xlabel("t [s]")
    return positions.figure


Run.plot = plot
