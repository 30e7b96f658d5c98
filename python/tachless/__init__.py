"""Velocity-free robot control from Python.

This package calls the laws, the plant, the protocol and the mechanics of the tachless programs. It computes nothing
itself. Angles are in rad, lengths in m, torques in N m (N on prismatic joints). ::

    run_controller(f)        your law as the controller of a run
    simulate(scenario)       the closed loop in this process, as arrays
    read(log)                a recorded run, as arrays
    certify, design, identify, sweep  results of the commands of these names, as objects
    Law(scenario)            the certified law in a loop of your own: a torque for each position
    linear(scenario)         the loop's map of one period, as matrices
    listen(channels)         the messages of a bus, as they come
    run.plot(), plot(run)    a picture of a run, by matplotlib
    Robot(urdf)              mechanics: inertia matrix, inverse and forward dynamics, poses
    Error                    an error of the programs, with their message; code is their exit code
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
__all__ = ["Error", "Law", "Linear", "Measurement", "Reference", "Result", "Robot", "Run", "certify", "design", "identify",
           "linear", "listen", "plot", "read", "run_controller", "simulate", "sweep"]

Path = Union[str, "os.PathLike[str]"]
LawFunction = Callable[[int, float, Measurement, Reference], ArrayLike]


def _settings(values: Mapping[str, Any]) -> list[str]:
    """Returns 'key=value' for each entry, with the value as JSON, which is also YAML."""

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
        locked: joints that are fixed at a position and removed from the robot, {name: rad or m}.
        base_rpy, base_xyz: orientation and position of the root link in the world, rad and m.
        check_inertia: "refuse" or "warn" about bodies with a physically impossible inertia.

    Raises:
        Error: the file does not describe a robot. The message names the file, the element and the remedy.

    n is the number of joints. q, v, a and tau have n numbers each.
    """

    def __init__(self, urdf: Path, *, gravity: float = 9.81, locked: Optional[Mapping[str, float]] = None,
                 base_rpy: Sequence[float] = (0, 0, 0), base_xyz: Sequence[float] = (0, 0, 0),
                 check_inertia: str = "refuse") -> None:
        super().__init__(
            _found(urdf),
            _settings({"robot.check_inertia": check_inertia,
                       "robot.base": {"rpy": list(base_rpy), "xyz": list(base_xyz)},
                       **({"robot.locked": dict(locked)} if locked else {})}), gravity)


class Law(_tachless.Law):
    """The scenario's law in a loop of your own: ``law = Law("arm.yaml")``, then ``tau = law.step(q)`` once per period.

    The constructor certifies the loop at the scenario's period and delay. The torques equal those of a run's log bit for
    bit, less the torque that the arm adds itself (robot.compensates). The scenario needs no reference, plant or duration
    if the references are yours.

    Args:
        scenario: path of the YAML file.
        bounds: of your own references, {"speed": ..., "acceleration": ..., "lower": ..., "upper": ...}, one number per
            joint or one for all, rad/s, rad/s² and rad (m/s, m/s², m). The positions default to the joints' ranges.
        overrides: values of the scenario by key.

    Raises:
        Error: the loop has no certificate (code 1), or the scenario is not valid (code 2).
    """

    def __init__(self, scenario: Path, *, bounds: Optional[Mapping[str, ArrayLike]] = None, **overrides: Any) -> None:
        names = ("speed", "acceleration", "lower", "upper")
        if unknown := set(bounds or ()) - set(names):
            raise _error(f"bounds: {sorted(unknown)[0]!r}; allowed: {', '.join(names)}", 2)
        declared = None if bounds is None else [np.atleast_1d(np.asarray(bounds.get(name, ()), float)).tolist()
                                                for name in names]
        super().__init__(_found(scenario), declared, _settings(overrides))


def _name_of(f: LawFunction, name: Optional[str]) -> str:
    return name or getattr(f, "__name__", None) or type(f).__name__


def simulate(scenario: Path, *, controller: Optional[LawFunction] = None, name: Optional[str] = None,
             **overrides: Any) -> Run:
    """Simulates the closed loop of a scenario in this process. The result equals a lock-step run's log bit for bit.

    Args:
        scenario: path of the YAML file.
        controller: a law as for run_controller that replaces the scenario's law.
        name: the controller's name; default: the name of the function.
        overrides: values of the scenario by key, ``simulate(file, **{"controller.gains.kp": [400, 300]})``.

    Raises:
        Error: the scenario is not valid (code 2), or a torque or state is not finite (code 5).
        KeyboardInterrupt: Ctrl-C, in the main thread.

    Other Python threads continue meanwhile, and several simulations may run at once. A Run cannot be sent to another
    process; its arrays can.
    """
    return _tachless.simulate(_found(scenario), _settings(overrides), controller,
                              "" if controller is None else _name_of(controller, name))


def read(log: Path, *, run_id: int = 0) -> Run:
    """Reads a run from a log.

    Args:
        log: path of the log, or of a run's directory.
        run_id: the run to read if the log holds several; default: the first.

    Raises:
        Error: the file is not a readable log (code 2).
    """
    return _tachless.read(os.fspath(log), run_id)


def run_controller(f: LawFunction, scenario: Optional[Path] = None, *, name: Optional[str] = None,
                   argv: Optional[Sequence[str]] = None) -> None:
    """Makes this process the controller of a run, with the law f. Returns when the run is over.

    f(k, t, measurement, reference) -> torque is called once per tick k, at the time t in s. The arguments hold numpy
    arrays: measurement.q, .v, .theta, .thetadot (None: not measured), reference.q, .v, .a, .jerk, .snap. f returns
    one number per joint, N m or N. f keeps its own memory between ticks.

    If f has a method reset(), it is called before the first tick, and again when a gap in realtime is too long to be
    stepped over. If f has a method set_gains(gains), it is called before the run with the scenario's
    controller.gains, arrays by name. An exception of set_gains refuses the gains (code 2).

    Args:
        f: the law.
        scenario: path of the YAML file, if the command line does not begin with one.
        name: the law's name in logs and reports; default: the name of the function.
        argv: command line as for tachless-controller; default: sys.argv.

    Raises:
        SystemExit: the run failed. The code is an exit code of the programs, and stderr gives the reason.
    """
    words = list(sys.argv if argv is None else argv) or ["tachless-controller"]
    if scenario is not None and not any(not word.startswith("-") for word in words[1:2]):
        words.insert(1, os.fspath(scenario))
    code = _tachless.run_controller(words, f, _name_of(f, name))
    if code != 0:
        raise SystemExit(code)


class Result(dict):
    """The result of a command: the fields of its --json as items and attributes. It prints as the command does.

    messages is the command's output on stderr. objection is true if the command objected (exit code 1).
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
    """Returns the tachless program: $TACHLESS, or that of this installation or build, or that of the PATH."""
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
    """Returns the path of a scenario or URDF as the programs find it: here, or in the installation's scenarios."""
    name = os.fspath(file).removeprefix("scenarios/")
    with contextlib.suppress(Error):  # without a program, the error message names the missing file
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
    if done.returncode not in (0, 1) or not done.stdout.startswith("{"):  # for example the output of --help
        raise _error(done.stderr.strip().removeprefix("tachless: ") or
                     f"tachless {verb} has no result with these options; type them in a shell", done.returncode or 2)
    result = Result(json.loads(done.stdout))
    result.__dict__.update(messages=done.stderr, objection=done.returncode != 0)
    return result


def _options(values: Mapping[str, Any]) -> list[str]:
    """Returns the options of a command: --count-share=0.02 for {"count_share": 0.02}, commas in a list."""
    text = {key: ",".join(map(str, value)) if isinstance(value, (list, tuple, np.ndarray)) else str(value)
            for key, value in values.items() if value is not None}
    return [f"--{key.replace('_', '-')}={value}" for key, value in text.items()]


def certify(scenario: Path, controller: Optional[str] = None, full: bool = False, **overrides: Any) -> Result:
    """Certifies the scenario's loop: stability, margins and the errors it recovers from (tachless certify).

    Args:
        scenario: path of the YAML file.
        controller: the program with the law, as typed in a shell: "python3 law.py".
        full: also examine the nonlinear sampled loop and missed ticks, which takes seconds.
        overrides: values of the scenario by key.

    Raises:
        Error: the scenario is not valid (code 2).
    """
    words = [scenario, *_options({"controller": controller}), *(["--full"] if full else [])]
    return _result("certify", words, overrides)


def design(robot: Path, *, write: Optional[Path] = None, overrides: Optional[Mapping[str, Any]] = None,
           **goal: Any) -> Result:
    """Designs gains for a scenario or a bare URDF (tachless design).

    Args:
        robot: path of a scenario or a URDF.
        write: a file for the scenario with these gains.
        overrides: values of the scenario by key.
        goal: the command's options: structure, rotors, settling, bandwidth, stiffness, rest_error, noise, margin,
            period, uncertain, ...

    Raises:
        Error: no gains suffice (code 1), or the scenario or an option is not valid (code 2).
    """
    return _result("design", [robot, *_options({"write": write, **goal})], overrides or {})


def identify(*logs: Path, unknown: Union[str, Sequence[str], None] = None, **options: Any) -> Result:
    """Identifies rotor inertia, friction and payload from logs of runs (tachless identify).

    Args:
        logs: paths of logs of one robot.
        unknown: names of the unknown parameters; None: rotor, viscous, coulomb, and a table's delay.
        options: the command's options: validate, write, on, without, all, force, ...

    Raises:
        Error: the parameters cannot be identified from a log (code 2).
    """
    if unknown is None or options.get("all"):  # the command refuses --unknown together with --all
        return _result("identify", [*logs, *_options(options)], {})
    names = [unknown] if isinstance(unknown, str) else list(unknown)
    return _result("identify", [*logs, *_options({"unknown": names, **options})], {})


def sweep(scenario: Path, vary: Optional[Mapping[str, Any]] = None, *, out: Optional[Path] = None,
          overrides: Optional[Mapping[str, Any]] = None, **options: Any) -> Result:
    """Runs a scenario many times with varied values, on all cores (tachless sweep).

    Args:
        scenario: path of the YAML file.
        vary: values by key, as for --vary, as a list or as text: {"controller.gains.kp*": "0.1:10:21:log"}.
        out: a directory for results.csv and index.html; default: out/sweep-NAME.
        overrides: values of the scenario by key.
        options: the command's options: random, seed, laws, bandwidth, colour, threads.

    Returns:
        The fields of --json, and table: the columns of results.csv by name, arrays (runs,), with NaN for a missing number.

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
    """A linear loop x[k+1] = A x[k] + B u[k], y[k] = C x[k] + D u[k] of period h [s] about rest at a posture (n,).

    x, u and y are deviations from rest. states names the entries of x with units: q and v of the n links, theta and
    thetadot of flexible joints, a current loop's torques, the law's memory, and delayed torques. With a delay of d ticks,
    the encoder's latency included, the delayed torques are tau[k-1] to tau[k-d]; the last of them acts now. u (n,) is a
    torque that is added to the law's torque before the delay. inputs and outputs name the entries of u and y.
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
    """Linearises the loop over one period about rest, with the torque held. certify examines this linear loop.

    y is q, and the eigenvalues of A are the loop's modes. With open_loop, the law's feedback is cut at its torque, and y
    is the negative of that torque. A - B C is then the closed loop's A. The compensation of gravity stays closed.

    Args:
        scenario: path of the YAML file.
        posture: joint positions (n,), rad or m; default: the beginning of the reference.
        open_loop: cut the loop at the law's torque.
        overrides: values of the scenario by key.

    Raises:
        Error: the scenario is not valid, or its law cannot be linearised (code 2).
    """
    return Linear(**_tachless.linear(_found(scenario), _settings(overrides), posture, open_loop))


def listen(*channels: str, lcm_url: Optional[str] = None, seconds: float = 1e9) -> Iterator[dict[str, Any]]:
    """Yields the messages on a bus: ``for m in listen("ARM_COMMAND"): print(m["tick"], m["torque"])``.

    A message has channel, type, utime [us], run, tick, and the fields of its .lcm file, with lists as arrays. The tags of
    keyed messages are not verified. A slow reader does not delay a run; it loses messages, and tick has gaps. Ctrl-C ends
    the iteration.

    Args:
        channels: names, as in tachless watch; none: all.
        lcm_url: the bus; default: LCM_DEFAULT_URL, or the programs' default.
        seconds: time without a message after which the iteration ends.

    Raises:
        Error: the bus cannot be joined (code 2).
    """
    bus = _tachless.Listener(channels, lcm_url or "")
    return ({name: np.array(value) if isinstance(value, list) else value for name, value in json.loads(text).items()}
            for text in iter(lambda: bus.take(min(seconds, 1e9)), ""))


def plot(run: Run, axes: Any = None) -> Any:
    """Plots position and reference, error and torque of each joint over time with matplotlib. Returns the figure.

    Args:
        run: the run to plot.
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
