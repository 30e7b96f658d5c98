"""Compares the Python package with the C++ programs. Arguments: the directory of the programs, that of the scenarios."""

import ast
import importlib.util
import inspect
import json
import os
import pathlib
import re
import shutil
import signal
import struct
import subprocess
import sys
import tempfile
import threading
import unittest

import numpy as np
import tachless

programs, scenarios = map(pathlib.Path, sys.argv[1:3])
examples = scenarios.parent / "examples" / "python"
paper = scenarios / "paper_rigid.yaml"
arm = scenarios / "robots" / "two_link.urdf"
short = {"loop.duration_s": 0.1}


def tachless_command(*words, code=0):
    """Returns stdout and stderr of the program, which has to end with `code`."""
    done = subprocess.run([programs / "tachless", *map(str, words)], capture_output=True, text=True, check=False)
    assert done.returncode == code, f"{words}: exit code {done.returncode}\n{done.stdout}{done.stderr}"
    return done.stdout + done.stderr


class Folder(unittest.TestCase):
    def setUp(self):
        folder = tempfile.TemporaryDirectory()
        self.addCleanup(folder.cleanup)
        self.folder = pathlib.Path(folder.name)

    def script(self, text):
        path = self.folder / "law.py"
        path.write_text("import numpy as np\nimport tachless\n" + text)
        return f"{sys.executable} {path}"

    def run_paper(self, controller, *more, out="run", code=0):
        shutil.rmtree(self.folder / out, ignore_errors=True)
        return tachless_command("run", paper, "--duration", 0.1, "--run-id", 7, "--out", self.folder / out,
                                "--controller", controller, *more, code=code)


class AnObjectWithoutAValue(unittest.TestCase):
    def test_raises_where_it_is_used(self):
        module = tachless._tachless
        for kind, use in ((module.Run, repr), (module.Run, lambda run: run["q"]), (module.Run, lambda run: run.joints),
                          (module.Measurement, lambda measurement: measurement.q), (module.Reference, lambda reference: reference.q),
                          (module.Robot, lambda robot: robot.M([0, 0])), (tachless.Robot, lambda robot: robot.joints),
                          (module.Listener, lambda listener: listener.take(0)), (module.Law, lambda law: law.step([0, 0]))):
            for maker in kind, module.Run.__base__:
                with self.subTest(kind=kind, maker=maker), self.assertRaisesRegex(TypeError, "has no value"):
                    use(maker.__new__(kind))


class TheRobot(unittest.TestCase):
    def setUp(self):
        self.robot = tachless.Robot(arm)
        self.q, self.v, self.a = np.array([0.3, -0.7]), np.array([0.5, 1.5]), np.array([-2.0, 4.0])

    def test_mechanics_are_consistent(self):
        robot, q, v, a = self.robot, self.q, self.v, self.a
        tau = robot.M(q) @ a + robot.C(q, v) @ v + robot.g(q)
        # Both sum the same terms, up to 100 N m, in different orders.
        np.testing.assert_allclose(robot.ID(q, v, a), tau, rtol=0, atol=1e-12)
        np.testing.assert_allclose(robot.FD(q, v, tau), a, rtol=0, atol=1e-12)
        np.testing.assert_allclose(tachless.Robot(arm, gravity=0).g(q), 0, atol=0)

    def test_mechanics_are_those_of_the_program(self):
        facts = json.loads(tachless_command("robot", arm, "--position", "0.3,-0.7", "--json"))
        np.testing.assert_array_equal(self.robot.M(self.q), facts["inertia_matrix"])
        np.testing.assert_array_equal(self.robot.g(self.q), facts["gravity_torque"])

    def test_names_and_poses(self):
        robot = self.robot
        self.assertEqual((robot.num_joints, robot.joints), (2, ["shoulder", "elbow"]))
        self.assertEqual(robot.lower.shape, (2,))
        turned = robot.pose(robot.links[-1], self.q)
        np.testing.assert_allclose(turned[:3, :3] @ turned[:3, :3].T, np.eye(3), atol=1e-15)
        self.assertEqual(turned[3].tolist(), [0, 0, 0, 1])

    def test_a_locked_joint_is_none(self):
        self.assertEqual(tachless.Robot(arm, locked={"elbow": 0.5}).joints, ["shoulder"])

    def test_errors_name_the_thing_the_value_and_the_remedy(self):
        for action, words in [
            (lambda: tachless.Robot("nothing.urdf"), "nothing.urdf: no such file"),
            (lambda: tachless.Robot(paper), "paper_rigid.yaml: a scenario; give the file of its robot.urdf"),
            (lambda: tachless.Robot(arm, locked={"nose": 0}), "nose"),
            (lambda: self.robot.M([1, 2, 3]), "q has the shape (3); needed: (2,)"),
            (lambda: self.robot.g("far"), "q is 'far'; needed: 2 numbers"),
            (lambda: self.robot.g([1j, 0]), "q is [1j, 0]; needed: 2 numbers"),
            (lambda: self.robot.g([None, 0]), "q is [None, 0]; needed: 2 numbers"),
            (lambda: tachless.Robot(arm, gravity=np.nan), "gravity: nan; allowed: a finite number"),
            (lambda: self.robot.pose("nose", self.q), "link: \"nose\"; this robot has"),
        ]:
            with self.assertRaises(tachless.Error) as raised:
                action()
            self.assertIn(words, str(raised.exception))
            self.assertEqual(raised.exception.code, 2)


class Runs(Folder):
    def test_simulation_recording_and_export_are_the_same_numbers(self):
        tachless_command("run", paper, "--in-process", "--duration", 0.1, "--out", self.folder / "run")
        tachless_command("export", self.folder / "run", "-o", self.folder / "run.csv")
        table = np.genfromtxt(self.folder / "run.csv", delimiter=",", names=True)
        read, simulated = tachless.read(self.folder / "run"), tachless.simulate(paper, **short)
        self.assertEqual(read.names, simulated.names)
        for name in read.names:
            np.testing.assert_array_equal(read[name], simulated[name], err_msg=name)
        for column, joint in enumerate(read.joints):
            for name in ("q", "q_ref", "tau", "nu", "q_measured"):
                exported = table[f"{name}_{joint}_{read.units(name)[column]}"]
                np.testing.assert_array_equal(read[name][:, column], exported, err_msg=name)
        self.assertEqual(read["q"].shape, (2000, 2))
        self.assertEqual((read.law, read.run_id != 0, read.period_s), ("loria_ortega_rigid", True, 5e-5))
        np.testing.assert_array_equal(read.t, table["t_s"])

    def test_overrides(self):
        soft = tachless.simulate(paper, **short, **{"controller.gains.kp": np.array([400, 300])})
        stiff = tachless.simulate(paper, **short)
        np.testing.assert_array_equal(soft["error"][0], stiff["error"][0])
        # Kp e of the first nonzero error is smaller, because the gain is.
        self.assertLess(np.abs((soft["tau"] - stiff["tau"])[:, 0]).max(), 5000 * np.abs(stiff["error"]).max())
        self.assertTrue(np.any(soft["tau"] != stiff["tau"]))
        self.assertRegex(soft.text, r"kp:\s*\n?.*400")
        with self.assertRaisesRegex(tachless.Error, "controller.gains.kp.*-1"):
            tachless.simulate(paper, **{"controller.gains.kp": -1})

    def test_a_log_that_is_none(self):
        with self.assertRaisesRegex(tachless.Error, "nowhere"):
            tachless.read(self.folder / "nowhere")
        with self.assertRaisesRegex(KeyError, "flavour: this run has q, v"):
            tachless.simulate(paper, **short)["flavour"]

    def test_installed_scenarios_are_found_as_the_command_finds_them(self):
        self.addCleanup(os.chdir, os.getcwd())
        os.chdir(self.folder)
        for name in ("paper_rigid", "paper_rigid.yaml", pathlib.Path("scenarios/paper_rigid.yaml")):
            self.assertEqual(tachless.linear(name).h, tachless.linear(paper).h)
        self.assertEqual(tachless.simulate("scenarios/regulation.yaml", **short).scenario, "regulation")
        self.assertEqual(tachless.Robot("robots/two_link.urdf").joints, ["shoulder", "elbow"])
        with self.assertRaisesRegex(tachless.Error, "^scenarios/nothing.yaml: no such file"):
            tachless.simulate("scenarios/nothing.yaml")
        pathlib.Path("paper_rigid.yaml").write_text("flavour: 1\n")  # a local file comes first
        with self.assertRaisesRegex(tachless.Error, "flavour"):
            tachless.simulate("paper_rigid.yaml")

    def test_a_law_in_the_simulation(self):
        spring = tachless.simulate(paper, controller=lambda k, t, m, r: 400 * (r.q - m.q), name="spring", **short)
        self.assertEqual(spring.law, "spring (external)")
        np.testing.assert_array_equal(spring["tau"], 400 * (spring["q_ref"] - spring["q"]))
        with self.assertRaises(tachless.Error) as raised:
            tachless.simulate(paper, controller=lambda k, t, m, r: [0, 0, 0], name="wide", **short)
        self.assertEqual(str(raised.exception), "the torque of wide has the shape (3); needed: (2,), at tick 0")
        for name, law, words in [
            ("silent", lambda k, t, m, r: None, "the torque of silent is None; needed: 2 numbers, at tick 0"),
            ("leaving", lambda k, t, m, r: sys.exit(0), "the law leaving raised SystemExit: 0, at tick 0"),
            ("number", 5, "the law number raised TypeError: 'int' object is not callable, at tick 0"),
        ]:
            with self.assertRaisesRegex(tachless.Error, words):
                tachless.simulate(paper, controller=law, name=name, **short)

    def test_ctrl_c_ends_a_simulation(self):
        # Simulates an hour. The timer can run and end the simulation only while Python is unlocked.
        with self.assertRaises(KeyboardInterrupt):
            threading.Timer(0.5, signal.raise_signal, [signal.SIGINT]).start()
            tachless.simulate(paper, **{"loop.duration_s": 3600})

        def interrupted(k, t, m, r):
            if k == 10:
                signal.raise_signal(signal.SIGINT)
            return 0 * m.q

        with self.assertRaises(KeyboardInterrupt):
            tachless.simulate(paper, controller=interrupted, **short)


class Controllers(Folder):
    def test_the_papers_law_in_python_commands_what_it_does_in_cpp(self):
        law = f"{sys.executable} {examples / 'loria_ortega.py'}"
        said = self.run_paper(law)
        self.assertIn("paper_rigid: loria_ortega (external)", said)
        own, inside = tachless.read(self.folder / "run"), tachless.simulate(paper, **short)
        # exp and expm1 of numpy and C may differ in the last bit. The gains are 1e4 per radian.
        np.testing.assert_allclose(own["tau"], inside["tau"], rtol=0, atol=1e-9 * np.abs(inside["tau"]).max())
        self.assertIn("the same: 2000 commands, bit for bit",
                      tachless_command("replay", self.folder / "run", "--controller", law))
        self.run_paper(law, "--in-process", out="alone")
        self.assertEqual((self.folder / "run/lcmlog").read_bytes(), (self.folder / "alone/lcmlog").read_bytes())

    def test_certify_asks_it(self):
        text = (examples / "loria_ortega.py").read_text().replace("__file__", repr(str(examples / "loria_ortega.py")))
        # The law takes the period at which it is asked in place of its own.
        text = text.replace("    if k > 0:", "    h = t / k if k else 0\n    if k > 0:")
        own = tachless.certify(paper, controller=self.script(text)).sampled
        inside = tachless.certify(paper).sampled
        # The margins differ a little, because the law's compensation of gravity is not known separately.
        for key, part in {"limit_s": 1e-5, "spectral_radius": 1e-7, "settling_s": 1e-4, "margins": 1e-5}.items():
            is_, expected = (np.array(list(x[key].values()) if key == "margins" else x[key]) for x in (own, inside))
            np.testing.assert_allclose(is_, expected, rtol=part, err_msg=key)
        for torque, why in {"np.random.normal(size=2)": "two identical experiments differ",
                            "np.clip(-5e5 * (m.q - r.q), -1, 1)": "its answers do not superpose"}.items():
            result = tachless.certify(paper, controller=self.script(
                f"tachless.run_controller(lambda k, t, m, r: {torque}, name='f')\n"))
            self.assertTrue(result.objection)
            self.assertIn(why, result.messages)

    def test_what_the_law_raises_ends_the_run(self):
        law = self.script("def broken(k, t, m, r):\n    return 1 / (100 - k) * m.q\ntachless.run_controller(broken)\n")
        said = self.run_paper(law, code=5)
        self.assertIn("the law broken raised ZeroDivisionError: division by zero, at tick 100", said)
        self.assertIn("in broken", said)
        law = self.script("def stopping(k, t, m, r):\n    raise KeyboardInterrupt\ntachless.run_controller(stopping)\n")
        self.assertIn("the law stopping raised KeyboardInterrupt: , at tick 0", self.run_paper(law, code=5))

    def test_what_set_gains_raises_ends_it_before_the_run(self):
        law = self.script("class Law:\n    def set_gains(self, gains): raise ValueError('kp is too large')\n"
                          "    def __call__(self, k, t, m, r): return 0 * m.q\ntachless.run_controller(Law())\n")
        said = self.run_paper(law, code=2)
        self.assertIn("the law Law raised ValueError: kp is too large, in set_gains", said)
        self.assertNotIn("internal error", said)

    def test_a_torque_that_is_not_finite_ends_the_run(self):
        law = self.script("tachless.run_controller(lambda k, t, m, r: m.q * (np.nan if k == 50 else 0), name='nan')\n")
        self.assertIn("of law nan at tick 50 is not finite", self.run_paper(law, code=5))

    def test_a_command_line_without_words_has_no_scenario(self):
        for arguments, words in [("", "SCENARIO is required"), ("'nothing.yaml', ", "nothing.yaml: no such file")]:
            script = self.script(f"tachless.run_controller(lambda k, t, m, r: 0 * m.q, {arguments}argv=[], name='f')\n")
            done = subprocess.run(script.split(), capture_output=True, text=True, check=False)
            self.assertEqual(done.returncode, 2)
            self.assertIn(words, done.stderr)

    def test_a_replay_slower_than_the_run_has_a_speed(self):
        law = "tachless.run_controller(lambda k, t, m, r: 0 * m.q, name='still')\n"
        self.run_paper(self.script(law), "--any-outcome", "--force")
        # 0.1 s of the robot's time takes at least 0.5 s. A speed below one half was once printed as 0.
        slow = self.script("import time\n" + law.replace("0 * m.q", "(time.sleep(0.5 * (k == 0)), 0 * m.q)[1]"))
        said = tachless_command("replay", self.folder / "run", "--controller", slow)
        self.assertRegex(said, r"s: 0\.[0-9]+ times as fast")

    def test_it_hears_positions_and_nothing_else(self):
        law = self.script("def deaf(k, t, m, r):\n    assert m.v is m.theta is m.thetadot is None\n    return 0 * m.q\n"
                          "tachless.run_controller(deaf)\n")
        self.run_paper(law, "--force")

    def test_its_memory_begins_anew_with_reset(self):
        law = self.script("class Law:\n    def reset(self): self.n = 0\n"
                          "    def __call__(self, k, t, m, r):\n        self.n += 1\n        return m.q * 0 + 1e-6 * self.n\n"
                          "tachless.run_controller(Law())\n")
        self.run_paper(law, "--any-outcome", "--force")
        run = tachless.read(self.folder / "run")
        self.assertEqual(run.law, "Law (external)")
        np.testing.assert_array_equal(run["tau"][:, 0], 1e-6 * np.arange(1, 2001))

    def test_gaps_in_realtime_are_stepped_over_along_a_straight_line(self):
        # According to its log, the controller acts on no tick from 100 to 110.
        tachless_command("run", scenarios / "practical_rigid.yaml", "--mode", "realtime", "--isolate", "--any-outcome",
                         "--duration", 0.2, "--out", self.folder / "run", "--set", "loop.max_missed=100",
                         "--set", "loop.max_missed_share=1")
        log, whole, at = b"", (self.folder / "run/lcmlog").read_bytes(), 0
        while at < len(whole):
            channel_size, size = struct.unpack_from(">ii", whole, at + 20)
            message = at + 28 + channel_size
            tick, = struct.unpack_from(">q", whole, message + 24)
            if whole[at + 28: message] not in (b"ARM_COMMAND", b"ARM_CONTROLLER_STATE") or not 100 <= tick <= 110:
                log += whole[at: message + size]
            at = message + size
        (self.folder / "gap").write_bytes(log)
        law = self.script(f"""
calls = []
def law(k, t, m, r):
    calls.append([k, t, *m.q, *r.q])
    if k == 150: np.save("{self.folder}/calls.npy", calls)
    return 0 * m.q
tachless.run_controller(law)
""")
        tachless_command("replay", self.folder / "gap", "--controller", law)
        calls = np.load(self.folder / "calls.npy")
        np.testing.assert_array_equal(calls[:, 0], np.arange(calls[0, 0], 151))
        np.testing.assert_allclose(calls[:, 1], 1e-3 * calls[:, 0], rtol=1e-15)
        before, *gap, after = calls[calls[:, 0] >= 99][:13, 2:]
        shares = np.arange(1, 12)[:, None] / 12
        # Some roundings of positions below 0.1 rad. The reference of 5 Hz deviates from the line by up to 5e-4 rad.
        np.testing.assert_allclose(gap, before + shares * (after - before), rtol=0, atol=1e-15)


class Documentation(unittest.TestCase):
    def test_everything_public_has_a_docstring_and_annotations(self):
        public = [getattr(tachless, name) for name in tachless.__all__ if name not in ("Measurement", "Reference", "Error")]
        for thing in public:
            self.assertTrue(thing.__doc__, thing)
            if inspect.isfunction(thing):
                self.assertIn("return", thing.__annotations__, thing)
                continue
            for name, member in inspect.getmembers(thing):
                if not name.startswith("_") and not hasattr(dict, name):
                    # The text follows the line with the signature, which pybind11 writes.
                    self.assertTrue(member.__doc__.split("\n\n", 1)[callable(member)], name)

    def test_the_examples_run(self):
        with tempfile.TemporaryDirectory() as folder:
            plot = pathlib.Path(folder) / "plot.svg"
            out = subprocess.run([sys.executable, examples / "sweep.py", scenarios / "practical_rigid.yaml", plot],
                                 capture_output=True, text=True, check=True).stdout
            self.assertEqual(len(out.splitlines()), 4)
            self.assertIn("rms position error", plot.read_text())
            tachless_command("run", paper, "--in-process", "--duration", 0.05, "--out", folder)
            out = subprocess.run([sys.executable, examples / "read_log.py", folder], capture_output=True, text=True,
                                 check=True).stdout
            self.assertIn("shoulder: largest error", out)

    def test_the_papers_law_takes_fifteen_lines(self):
        tree = ast.parse((examples / "loria_ortega.py").read_text())
        law = next(node for node in tree.body if isinstance(node, ast.FunctionDef))
        self.assertLessEqual(law.end_lineno - law.lineno + 1, 15)


class TheLawInALoopOfOnesOwn(Folder):
    scenario = scenarios / "practical_rigid.yaml"

    def test_has_the_bits_of_the_log(self):
        tachless_command("run", self.scenario, "--in-process", "--quiet", "--duration", 0.3, "--out", self.folder / "log")
        run = tachless.read(self.folder / "log")
        measured, references = run["q_measured"], zip(run["q_ref"], run["v_ref"], run["a_ref"], run["jerk_ref"], run["snap_ref"])
        law = tachless.Law(self.scenario)
        for _ in range(2):
            np.testing.assert_array_equal([law.step(q) for q in measured], run["tau"])
            law.reset()
        bounds = {"speed": 2, "acceleration": 100, "lower": [-1, -1], "upper": 1}
        other = tachless.Law(self.scenario, bounds=bounds)
        torques = [other.step(q, reference) for q, reference in zip(measured, references)]
        np.testing.assert_array_equal(torques, run["tau"])
        # A list of integers is taken too, and ticks may be left out.
        np.testing.assert_array_equal(law.step([0, 0], tick=5), tachless.Law(self.scenario).step(np.zeros(2), tick=5))
        self.assertEqual(law.tick, 6)

    def test_certifies_or_refuses(self):
        law = tachless.Law(self.scenario, **{"loop.period_s": 0.002})
        self.assertIn("stable at 500 Hz with 1 tick of delay", law.certificate)
        self.assertEqual((law.period_s, law.joints, law.tick), (0.002, ["shoulder", "elbow"], 0))
        self.assertAlmostEqual(law.limit_s, tachless.certify(self.scenario).sampled["limit_s"], delta=1e-6)
        with self.assertRaisesRegex(tachless.Error, "no certificate: unstable at 166.7 Hz") as raised:
            tachless.Law(self.scenario, **{"loop.period_s": 0.006})
        self.assertEqual(raised.exception.code, 1)
        with self.assertRaisesRegex(tachless.Error, "bounds: 'velocity'; allowed: speed"):
            tachless.Law(self.scenario, bounds={"velocity": 1})

    def test_raises_where_there_is_no_torque(self):
        law = tachless.Law(self.scenario, bounds={"speed": 1, "acceleration": 10})
        zero = np.zeros(2)
        for wrong, reason in ((lambda: law.step([0, np.nan]), "position of joint 2 .elbow. at tick 0 is not finite"),
                              (lambda: law.step([0, 0, 0]), r"q has the shape \(3\); needed: \(2,\)"),
                              (lambda: law.step(zero, (zero, [2, 0], zero)), "beyond its bounds"),
                              (lambda: law.step(zero, zero), "needed: .q, v, a."),
                              (lambda: law.step(zero, tick=-1), "call reset")):
            with self.subTest(reason=reason), self.assertRaisesRegex(tachless.Error, reason):
                wrong()
        self.assertEqual(law.step(zero).shape, (2,))

    def test_a_run_iterates_over_its_names(self):
        run = tachless.simulate(self.scenario, **short)
        self.assertEqual(list(run), run.names)
        self.assertEqual(len(run), len(run.names))
        self.assertIn("tau", {name: run[name] for name in run})

    def test_the_example_of_mujoco_follows_the_reference(self):
        environment = dict(os.environ)
        if importlib.util.find_spec("mujoco") is None:  # a stand-in has the names of MuJoCo that the example uses
            environment["PYTHONPATH"] += f":{pathlib.Path(__file__).parent / 'stand_in'}"
        out = subprocess.run([sys.executable, examples / "mujoco_loop.py", self.scenario, arm, "200"], capture_output=True,
                             text=True, check=True, env=environment).stdout
        error = float(re.search(r"largest error (\S+) rad", out)[1])
        self.assertIn("stable at 1 kHz", out)
        run = tachless.simulate(self.scenario, **{"loop.duration_s": 0.2})
        expected = abs(run["q"] - run["q_ref"]).max()  # the arm follows from rest a reference that moves at once
        self.assertAlmostEqual(error, expected, delta=0.02 * expected)  # steps of 50 us, three digits printed

    def test_the_example_of_hardware_leaves_missed_ticks_out_and_brakes(self):
        sys.path.insert(0, str(examples))
        self.addCleanup(sys.path.remove, str(examples))
        hardware_loop = importlib.import_module("hardware_loop")

        class Arm:
            reads, sent, braked = 0, [], False

            def read(self):
                self.reads += 1
                return None if self.reads == 3 else np.zeros(2)

            def send(self, torque):
                self.sent.append(torque)
                if len(self.sent) == 20:
                    raise OSError("no arm")

            def brake(self):
                self.braked = True

        played = Arm()
        with self.assertRaisesRegex(OSError, "no arm"):
            hardware_loop.control(played, tachless.Law(self.scenario), 1e9)
        self.assertTrue(played.braked)
        self.assertEqual((played.reads, len(played.sent)), (21, 20))


class TheLinearLoop(unittest.TestCase):
    still = scenarios / "regulation.yaml"
    late = {"loop.command_delay": 1}

    def test_its_modes_are_those_of_certify(self):
        loop, found = tachless.linear(self.still, **self.late), tachless.certify(self.still, **self.late).sampled
        radius = np.abs(np.linalg.eigvals(loop.A)).max()
        # Two eigenvalue solvers, for a matrix with torques of 1e4 N m and angles.
        self.assertAlmostEqual(radius, found["spectral_radius"], delta=1e-9)
        self.assertAlmostEqual(-np.log(radius) / loop.h, found["decay_per_s"], delta=1e-6 * found["decay_per_s"])
        # One joint starts beside the posture, at rest, with a settled filter.
        n, m = 2, len(loop.A) - 2
        memory = slice(4, m)
        settled = 0
        for j in range(n):
            x = np.zeros(len(loop.A))
            x[j] = 1
            x[memory] = np.linalg.solve(np.eye(m - 4) - loop.A[memory, memory], loop.A[memory, j])
            for k in range(1, 1000):
                x = loop.A @ x
                if np.abs(loop.C @ x).max() > 0.01:
                    settled = max(settled, k * loop.h)
        self.assertAlmostEqual(settled, found["settling_s"], delta=1e-9)

    def test_cut_open_it_has_the_gain_margin_of_certify(self):
        cut, closed = tachless.linear(self.still, open_loop=True, **self.late), tachless.linear(self.still, **self.late)
        np.testing.assert_allclose(cut.A - cut.B @ cut.C, closed.A, rtol=1e-12)
        self.assertEqual((cut.inputs, cut.outputs), (closed.inputs, ["-tau shoulder [N m]", "-tau elbow [N m]"]))
        gain = tachless.certify(self.still, **self.late).sampled["margins"]["gain"]
        for factor, stable in (0.999 * gain, True), (1.001 * gain, False):
            self.assertEqual(np.abs(np.linalg.eigvals(cut.A - factor * cut.B @ cut.C)).max() < 1, stable)

    def test_a_step_is_that_of_the_simulation(self):
        rest, beside = np.array([0.5, -0.3]), 1e-6 * np.array([1, -2])
        loop = tachless.linear(self.still, **self.late)
        np.testing.assert_array_equal(loop.posture, rest)
        self.assertEqual(loop.states, [
            "q shoulder [rad]", "q elbow [rad]", "v shoulder [rad/s]", "v elbow [rad/s]", "memory 1", "memory 2", "memory 3",
            "memory 4", "tau[k-1] shoulder [N m]", "tau[k-1] elbow [N m]"])
        self.assertEqual(loop.inputs, ["tau shoulder [N m]", "tau elbow [N m]"])
        self.assertEqual(loop.outputs, loop.states[:2])
        run = tachless.simulate(self.still, **self.late, **{"plant.initial.position_rad": rest + beside, "loop.duration_s": 0.2,
                                                            "plant.integrator.accuracy": 1e-12})
        # nu, e and tau of the previous tick are the memory and the delayed torques.
        states = np.hstack([run["q"][1:] - rest, run["v"][1:], run["nu"][:-1], run["error"][:-1],
                            run["tau"][:-1] - tachless.Robot(arm).g(rest)])
        for column, name in enumerate(loop.states):
            # The squares of errors of 1e-6 are 1e-6 of the errors. Rounding of q = 0.5 is 1e-10 of them.
            tolerance = 1e-5 * np.abs(states[:, column]).max()
            np.testing.assert_allclose(states[:-1] @ loop.A[column], states[1:, column], rtol=0, atol=tolerance, err_msg=name)

    def test_another_posture_and_motors_behind_springs(self):
        there = tachless.linear(scenarios / "practical_flexible.yaml", [0.1, -0.2])
        self.assertEqual(there.states[4:8], ["theta shoulder [rad]", "theta elbow [rad]", "thetadot shoulder [rad/s]",
                                             "thetadot elbow [rad/s]"])
        self.assertEqual((there.A.shape, there.B.shape), (2 * (len(there.states),), (len(there.states), 2)))
        self.assertFalse(np.array_equal(there.A, tachless.linear(scenarios / "practical_flexible.yaml").A))

    def test_errors_name_the_thing(self):
        for words, arguments in [
            (r"posture has the shape \(3\); needed: \(2,\)", {"posture": [0, 0, 0]}),
            ("posture: not finite", {"posture": [0, np.nan]}),
            ("controller.law: robust_differentiator cannot be linearised", {
                "controller.law": "robust_differentiator",
                "controller.gains": {"kp": [400, 24], "kd": [10, 1], "lipschitz": 100}}),
            ("controller.law.*nobody", {"controller.law": "nobody"}),
        ]:
            with self.assertRaisesRegex(tachless.Error, words) as raised:
                tachless.linear(self.still, **arguments)
            self.assertEqual(raised.exception.code, 2)


class TheBus(Folder):
    def in_a_network_of_its_own(self, text):
        """Runs a script and returns its stdout, line by line."""
        (self.folder / "script.py").write_text("import os, signal, subprocess, threading\nimport tachless\n" + text)
        network = "ip link set lo up multicast on && ip route add 224.0.0.0/4 dev lo && exec "
        alone = pathlib.Path(__file__).parents[1] / "support/private_network.sh"
        done = subprocess.run(["sh", alone, "sh", "-c", f"{network}{sys.executable} {self.folder}/script.py"],
                              capture_output=True, text=True, check=False, timeout=120)
        self.assertEqual((done.returncode, done.stderr), (0, ""))
        return done.stdout.splitlines()

    def test_messages_are_those_that_the_log_has(self):
        self.in_a_network_of_its_own(f"""
commands = tachless.listen("ARM_COMMAND", seconds=0.2)
everything = tachless.listen(seconds=0.2)
subprocess.run(["{programs}/tachless", "run", "{paper}", "--duration", "0.005", "--out", "{self.folder}/run"], check=True,
               stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
log = tachless.read("{self.folder}/run")
heard = list(commands)
assert {{m["tick"]: m["torque"].tolist() for m in heard}} == dict(enumerate(log["tau"].tolist())), heard
assert {{(m["channel"], m["type"], m["run"]) for m in heard}} == {{("ARM_COMMAND", "tachless.torque_command_t", log.run_id)}}
kinds = {{m["type"]: m for m in everything}}
assert not [name for m in kinds.values() for name in m if "[" in name]
state = kinds["tachless.controller_state_t"]
assert any((state["value"] == log["nu"][state["tick"]]).all(axis=1)) and state["value"].shape[1:] == (2,), state
assert kinds["tachless.participant_t"]["roster"].shape == (4,)
assert kinds["tachless.reference_t"]["position"].shape == (2,)
assert kinds["tachless.participant_t"]["role"] in ("plant", "reference", "controller", "logger")
assert "loria_ortega_rigid" in kinds["tachless.run_info_t"]["scenario"] and isinstance(kinds["tachless.tick_t"]["last"], bool)
""")

    def test_ctrl_c_ends_it_while_nothing_comes(self):
        said = self.in_a_network_of_its_own("""
threading.Timer(0.3, os.kill, [os.getpid(), signal.SIGINT]).start()
try:
    next(tachless.listen("ARM_COMMAND"))
except KeyboardInterrupt:
    print("ended")
""")
        self.assertEqual(said, ["ended"])

    def test_it_may_wait_for_as_long_as_one_says(self):
        said = self.in_a_network_of_its_own("""
for seconds in (1e10, float("inf")):
    threading.Timer(0.3, os.kill, [os.getpid(), signal.SIGINT]).start()
    try:
        print(list(tachless.listen("ARM_COMMAND", seconds=seconds)))
    except KeyboardInterrupt:
        print("ended")
""")
        self.assertEqual(said, ["ended", "ended"])

    def test_what_is_no_bus(self):
        with self.assertRaisesRegex(tachless.Error, "^LCM URL 'carrier://pigeon"):
            tachless.listen(lcm_url="carrier://pigeon")
        with self.assertRaisesRegex(tachless.Error, "channel"):
            tachless.listen(64 * "A")


class TheCommands(Folder):
    def test_five_minutes_from_a_urdf_to_a_picture(self):
        import matplotlib  # pylint: disable=import-outside-toplevel

        matplotlib.use("Agg")
        notebook = json.loads((examples / "first.ipynb").read_text())
        self.assertEqual(notebook["nbformat"], 4)
        cells = ["".join(cell["source"]) for cell in notebook["cells"] if cell["cell_type"] == "code"]
        lines = "\n".join(cells)
        self.assertEqual(len(lines.splitlines()), 10)
        self.assertIn(f"```python\n{lines}\n```", (scenarios.parent / "docs" / "python.md").read_text())
        shutil.copy(scenarios.parent / "examples" / "project" / "arm.urdf", self.folder)
        self.addCleanup(os.chdir, os.getcwd())
        os.chdir(self.folder)
        names = {}
        for cell in cells:
            exec(cell, names)  # pylint: disable=exec-used
        self.assertTrue(names["gains"].reached)
        self.assertTrue((self.folder / "arm.png").read_bytes().startswith(b"\x89PNG"))
        self.assertEqual(len(names["run"].plot().axes), 3)

    def test_certify_is_what_the_command_prints(self):
        found = tachless.certify(scenarios / "practical_rigid.yaml", **{"loop.command_delay": 2})
        printed = tachless_command("certify", scenarios / "practical_rigid.yaml", "--set", "loop.command_delay=2", "--quiet")
        self.assertEqual(str(found), printed)
        self.assertTrue(found.sampled["stable"])
        self.assertFalse(found.objection)
        slow = tachless.certify(scenarios / "practical_rigid.yaml", **{"loop.period_s": 0.05})
        self.assertTrue(slow.objection)
        self.assertIn("unstable", slow.messages)

    def test_errors_are_the_commands(self):
        with self.assertRaises(tachless.Error) as caught:
            tachless.certify(scenarios / "practical_rigid.yaml", **{"loop.delay": 2})
        self.assertEqual(caught.exception.code, 2)
        self.assertIn("loop.delay", str(caught.exception))
        with self.assertRaises(tachless.Error) as caught:
            tachless.design(arm, settling=-1)
        self.assertIn("--settling", str(caught.exception))
        with self.assertRaises(tachless.Error) as caught:
            tachless.identify(self.folder / "no_log")
        self.assertEqual(caught.exception.code, 2)

    def test_options_without_a_result_are_errors_with_a_message(self):
        for option in ({"help": True}, {"shard": "1/2"}, {"status": True}):
            with self.assertRaises(tachless.Error) as caught:
                tachless.sweep(scenarios / "practical_rigid.yaml", {"controller.gains.kp*": [0.5, 1]}, **option,
                               out=self.folder / "none", overrides={"loop.duration_s": 0.1})
            self.assertTrue(str(caught.exception), option)
            self.assertEqual(caught.exception.code, 2, option)

    def test_sweep_is_what_the_command_finds(self):
        scenario = scenarios / "practical_rigid.yaml"
        found = tachless.sweep(scenario, {"controller.gains.kp*": [0.5, 1], "loop.command_delay": "0,1"},
                               out=self.folder / "ours", overrides={"loop.duration_s": 0.1})
        printed = tachless_command("sweep", scenario, "--set", "loop.duration_s=0.1", "--vary", "controller.gains.kp*=0.5,1",
                                   "--vary", "loop.command_delay=0,1", "--out", self.folder / "theirs", "--quiet")
        self.assertEqual(str(found).replace("ours", "theirs"), printed)
        self.assertEqual((self.folder / "ours/results.csv").read_bytes(), (self.folder / "theirs/results.csv").read_bytes())
        self.assertEqual((found.runs, sum(found.outcomes.values())), (4, 4))
        np.testing.assert_array_equal(found.table["controller.gains.kp*"], [0.5, 0.5, 1, 1])
        self.assertEqual(found.table["law"].tolist(), 4 * ["loria_ortega_rigid"])
        with self.assertRaisesRegex(tachless.Error, "controller.gains.kp[*]=2:1:3.*"):
            tachless.sweep(scenario, {"controller.gains.kp*": "2:1:3:4:5"}, out=self.folder / "none")
        with self.assertRaisesRegex(tachless.Error, "nothing to vary"):
            tachless.sweep(scenario, out=self.folder / "none")

    def test_identify_finds_the_friction_of_the_emulated_arm(self):
        # A shorter motion than that of tests/analysis/identify/verb_test.cpp.
        tachless_command(
            "run", scenarios / "practical_rigid.yaml", "--in-process", "--any-outcome", "--duration", 3, "--out",
            self.folder / "run", "--set", "plant.mechanics=native", "--set",
            "plant.drive={viscous_friction_Nms_per_rad: [2, 1], coulomb_friction_Nm: [5, 0.5]}", "--set",
            "reference={multi_sine: {terms: [{amplitude_rad: 0.5, frequency_hz: [0.3, 0.4]}, "
            "{amplitude_rad: 0.2, frequency_hz: [0.8, 1.1]}]}}")
        found = tachless.identify(self.folder / "run", unknown=["viscous", "coulomb"], write=self.folder / "known.yaml")
        with self.assertRaisesRegex(tachless.Error, "known.yaml.*--force"):
            tachless.identify(self.folder / "run", write=self.folder / "known.yaml")
        again = tachless.identify(self.folder / "run", unknown=["viscous", "coulomb"], write=self.folder / "known.yaml",
                                  force=True)
        self.assertEqual(dict(again), dict(found))
        printed = tachless_command("identify", self.folder / "run", "--unknown", "viscous,coulomb", "--json", "--quiet")
        self.assertEqual(dict(found), json.loads(printed))
        rotor = dict(tachless.identify(self.folder / "run", unknown="rotor"))  # a string is one name, not a list of letters
        self.assertEqual(rotor, dict(tachless.identify(self.folder / "run", unknown=["rotor"])))
        self.assertEqual((found.method, found.validated, found.objection), ("output error", False, False))
        self.assertEqual([each["name"] for each in found.parameters],
                         ["viscous shoulder", "viscous elbow", "coulomb shoulder", "coulomb elbow"])
        for each, true in zip(found.parameters, [2, 1, 5, 0.5]):
            self.assertTrue(each["identifiable"])
            # The intervals from 3 s of data at 20 bits are about 1e-3 of the value.
            self.assertAlmostEqual(each["value"], true, delta=0.01 * true, msg=each["name"])
        self.assertEqual([each["name"] for each in found.joints], ["shoulder", "elbow"])
        self.assertTrue((self.folder / "known.yaml").is_file())

    def test_design_writes_what_it_returns(self):
        found = tachless.design(arm, settling=0.5, structure="diagonal", write=self.folder / "arm.yaml")
        self.assertEqual(len(found.gains["kp"]), 2)
        self.assertEqual(tachless.certify(self.folder / "arm.yaml").sampled["settling_s"], found.sampled["settling_s"])


if __name__ == "__main__":
    unittest.main(argv=sys.argv[:1] + sys.argv[3:])
