"""Runs in memory and in files: the program's numbers, scipy's names."""

import importlib.util
import os
import pickle
import subprocess
import tempfile
import unittest
import warnings

import numpy as np

import rubato as rb

PROGRAM = os.environ.get("RUBATO_PROGRAM")
PENDULUM = rb.Hamiltonian("q", "p", lambda q, p: p ** 2 / 2 - np.cos(q))


def setUpModule():
    warnings.simplefilter("ignore", rb.RubatoWarning)


class Memory(unittest.TestCase):
    def setUp(self):
        self.folder = tempfile.TemporaryDirectory()
        self.addCleanup(self.folder.cleanup)

    def path(self, name):
        return os.path.join(self.folder.name, name)

    @unittest.skipUnless(PROGRAM, "RUBATO_PROGRAM is not set")
    def test_the_catalogue_has_the_bits_of_the_program(self):
        for name in rb.catalogue():
            text = rb.show(name)
            short = self.short(name)
            file = self.path(name + ".h5")
            setting = ["--set", *short] if short else []
            subprocess.run([PROGRAM, "run", name, "--quiet", *setting, "-o", file], check=False,
                           stderr=subprocess.DEVNULL)
            memory = rb.run(name, settings=short)
            record = rb.open(file)
            compared = 0
            for path in memory.paths:
                if memory._info[path][2]:
                    continue
                np.testing.assert_array_equal(memory[path], record[path], err_msg=f"{name} {path}")
                compared += np.size(memory[path])
            self.assertGreater(compared, 50, name)
            self.assertEqual(text, rb.show(name))

    @staticmethod
    def short(name):
        """Orbits are run to their ends, lattices for a few steps."""
        problem = rb._core.read_problem(name, [])
        step = problem.step if problem.step is not None else 0.01
        return [f"scheme.until={problem.start + 5 * step!r}"] if problem.is_lattice else []

    def test_a_file_and_memory_hold_the_same(self):
        file = self.path("pendulum.h5")
        stored = rb.integrate(PENDULUM, [0, 1.9], (0, 20), step=0.1, file=file)
        memory = rb.integrate(PENDULUM, [0, 1.9], (0, 20), step=0.1)
        for path in memory.paths:
            np.testing.assert_array_equal(memory[path], stored[path])
        self.assertEqual(memory.figures["discrete_energy"], stored.figures["discrete_energy"])
        self.assertEqual(rb.check(file).status, 0)
        opened = rb.open(file)
        self.assertEqual(opened.figures["steps"], memory.figures["steps"])
        self.assertEqual((opened.verdict, opened.status, opened.message), ("good", 0, ""))
        self.assertIn(f"{len(memory.h)} steps, good", repr(opened))
        with self.assertRaises(FileExistsError):
            rb.integrate(PENDULUM, [0, 1.9], (0, 20), step=0.1, file=file)
        rb.integrate(PENDULUM, [0, 1.9], (0, 10), step=0.1, file=file, overwrite=True)
        longer = rb.resume(file, 20)
        np.testing.assert_array_equal(longer.y[:, :5], memory.y[:, :5])
        self.assertGreaterEqual(longer.t[-1], 20)
        self.assertIn("steps", str(rb.compare(file, file)))
        self.assertIn("<html", longer.page()[:500].lower())

    def test_scipys_names(self):
        t_eval = np.linspace(0, 20, 41)
        r = rb.integrate(PENDULUM, [0, 1.9], (0, 20), step=0.1, t_eval=t_eval, events=lambda t, y: y[0])
        np.testing.assert_array_equal(r.t, t_eval)
        self.assertEqual(r.y.shape, (2, 41))
        self.assertTrue(r.success)
        self.assertEqual(r.status, 0)
        self.assertEqual(r.message, "")
        every = rb.integrate(PENDULUM, [0, 1.9], (0, 20), step=0.1)
        np.testing.assert_allclose(every.sol(t_eval), r.y, atol=1e-12)
        np.testing.assert_array_equal(every.sol(every.t[7]), every.y[:, 7])
        self.assertEqual(len(r.t_events), 1)
        np.testing.assert_allclose(every.sol(r.t_events[0])[0], 0, atol=1e-9)
        self.assertGreater(len(r.t_events[0]), 2)
        with self.assertRaises(ValueError):
            every.sol(25.0)
        np.testing.assert_array_equal(r.q, r.y[0])
        self.assertLess(np.ptp(every.energy), 1e-12)
        self.assertGreater(np.ptp(every.H), 1e-11)

    def test_terminal_events(self):
        def down(t, y):
            return y[0]

        down.terminal, down.direction = True, -1
        r = rb.integrate(PENDULUM, [0, 1.9], (0, 20), step=0.1, events=down)
        self.assertLess(r.t[-1], 10)
        self.assertEqual(len(r.t_events[0]), 1)
        self.assertTrue(r.success)

    def test_a_ball_bounces(self):
        ball = rb.Hamiltonian("x", "v", "v^2/2 + x")
        floor = rb.Event("x", direction=-1, reset=lambda t, y: [0.0, -0.9 * y[1]])
        r = rb.integrate(ball, [1, 0], (0, 6), step=0.01, levels="fixed", events={"floor": floor})
        self.assertGreaterEqual(len(r.resets), 2)
        np.testing.assert_allclose(r.resets[0][0], np.sqrt(2), atol=1e-9)
        np.testing.assert_allclose(r.energies[1] / r.energies[0], 0.81, atol=1e-9)
        self.assertGreaterEqual(r.x.min(), -1e-9)
        self.assertTrue((np.diff(r.t) >= 0).all())
        without = rb.integrate(ball, [1, 0], (0, 6), step=0.01, levels="fixed")
        self.assertLess(without.x.min(), -1)

    def test_bounces_that_accumulate_are_doubtful(self):
        ball = rb.Hamiltonian("x", "v", "v^2/2 + x")

        def fall(reset):
            floor = rb.Event("x", direction=-1, reset=reset)
            return rb.integrate(ball, [1, 0], (0, 6), step=0.05, levels="fixed", events={"floor": floor})

        with self.assertWarnsRegex(rb.RubatoWarning, "event floor starts at its zero and has returned"):
            through = fall(lambda t, y: [0, -0.5 * y[1]])
        self.assertLess(through.x[-1], -0.1)
        self.assertEqual(through.verdict, "doubtful")
        self.assertEqual([reason["what"] for reason in through.reasons], ["event"])
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            at_rest = fall(lambda t, y: [0, -0.5 * y[1]] if y[1] < -1e-2 else None)
            passes = fall(lambda t, y: [0, 0.5 * y[1]])
        self.assertEqual(at_rest.verdict, "good")
        # The last level is the end of the step with the crossing: v h + h^2/2 below it at most.
        self.assertGreater(at_rest.x.min(), -(1e-2 * 0.05 + 0.05**2 / 2))
        self.assertEqual(passes.verdict, "good")

    def test_ensembles(self):
        states = np.column_stack([np.zeros(50), np.linspace(0.5, 1.5, 50)])
        common = dict(step=0.1, scheme="splitting", levels="fixed")
        many = rb.integrate(PENDULUM, states, (0, 10), **common)
        self.assertEqual(many.y.shape, (50, 2))
        for m in (0, 17, 49):
            one = rb.integrate(PENDULUM, states[m], (0, 10), **common)
            np.testing.assert_array_equal(one.y[:, -1], many.y[m])
        self.assertTrue(many.success)
        np.testing.assert_array_equal(many.q, many.y[:, 0])

    def test_stored_levels_of_an_ensemble(self):
        states = np.column_stack([np.zeros(5), np.linspace(0.5, 1.9, 5)])
        t_eval = np.linspace(0, 10, 21)
        many = rb.integrate(PENDULUM, states, (0, 10), step=0.1, t_eval=t_eval, events={"turn": rb.Event("p")})
        self.assertEqual(many.y.shape, (5, 2, 21))
        np.testing.assert_array_equal(many.t, t_eval)
        levels = rb.integrate(PENDULUM, states, (0, 10), step=0.1, every=3, scheme="midpoint")
        self.assertEqual(levels.y.shape[:2], (5, 2))
        ends = np.isfinite(levels.t).sum(axis=1)
        self.assertGreater(len(set(ends)), 1)  # variable levels: as many as each orbit has
        for m in range(5):
            one = rb.integrate(PENDULUM, states[m], (0, 10), step=0.1, t_eval=t_eval, events={"turn": rb.Event("p")})
            np.testing.assert_array_equal(many.y[m], one.y)
            np.testing.assert_array_equal(many[m].y, one.y)
            np.testing.assert_array_equal(many[m].events["turn"].t, one.events["turn"].t)
            self.assertEqual(many[m].verdict, one.verdict)
            self.assertIn(f"p = {float(states[m, 1])!r}", many[m].problem)
            one = rb.integrate(PENDULUM, states[m], (0, 10), step=0.1, every=3, scheme="midpoint")
            np.testing.assert_array_equal(levels.y[m, :, :ends[m]], one.y)
            np.testing.assert_array_equal(levels.t[m, :ends[m]], one.t)
            np.testing.assert_array_equal(levels.last[m], one.y[:, -1])
            self.assertTrue(np.isnan(levels.y[m, :, ends[m]:]).all())
            self.assertEqual(levels.steps[m], one.figures["steps"])
        self.assertEqual(many.verdict, "good")
        np.testing.assert_array_equal(many.q, many.y[:, 0])
        again = pickle.loads(pickle.dumps(many))
        np.testing.assert_array_equal(again.y, many.y)
        self.assertEqual(again.verdicts, many.verdicts)
        with self.assertRaisesRegex(TypeError, "pickled"):
            again[0]
        with self.assertRaisesRegex(AttributeError, "verdict"):
            many.verdic

    def test_members_that_end_early_and_verdicts(self):
        quartic = rb.Hamiltonian("q", "p", "p^2/2 - q^4/4")
        states = np.array([[0.5, 0.0], [0.7, 0.0], [1.5, 0.0]])  # the last one is at infinity before t = 1.24
        many = rb.integrate(quartic, states, (0, 2), step=0.01, levels="fixed", t_eval=[0, 1, 2])
        self.assertEqual(list(many.status == 0), [True, True, False])
        self.assertFalse(many.success)
        self.assertTrue(many.messages[2])
        self.assertEqual(many.message, "1 of 3 members ended early; the first: member 2: " + many.messages[2])
        self.assertEqual(rb.integrate(quartic, states[:2], (0, 1), step=0.01).message, "")
        with self.assertRaisesRegex(AttributeError, r"each member: give t_eval, every or events, and take r\[0\].laws"):
            many.laws
        self.assertTrue(len(many[0].t))
        self.assertTrue(np.isfinite(many.y[:2]).all())
        self.assertTrue(np.isnan(many.y[2, :, 2]).all())
        self.assertTrue(np.isfinite(many.y[2, :, 1]).all())

    def test_verdicts_of_orbits_side_by_side(self):
        states = np.column_stack([np.zeros(20), np.linspace(0.1, 1.9, 20)])
        how = dict(scheme="splitting", levels="fixed", composition="verlet")
        for step, expected in ((0.01, {"good"}), (1.2, {"good", "doubtful"})):
            many = rb.integrate(PENDULUM, states, (0, 50), step=step, **how)
            alone = [rb.integrate(PENDULUM, state, (0, 50), step=step, **how).verdict for state in states]
            self.assertEqual(many.verdicts, alone)
            self.assertLessEqual(set(alone), expected | {"lost"})
        self.assertNotEqual(many.verdict, "good")
        self.assertEqual(pickle.loads(pickle.dumps(many)).verdicts, alone)

    def test_ensembles_of_lagrangians_and_of_driven_systems(self):
        stated = rb.Lagrangian("q", lambda q, q_dot: 2 * (q_dot ** 2 / 2 + np.cos(q)))
        driven = rb.Hamiltonian("q", "p", lambda q, p, t: p ** 2 / 2 - np.cos(q) + 0.1 * q * np.sin(t))
        states = np.array([[0.0, 1.0], [0.1, 1.5]])
        for system in (stated, driven):
            many = rb.integrate(system, states, (0, 5), step=0.1)
            for m in range(2):
                np.testing.assert_array_equal(many.last[m], rb.integrate(system, states[m], (0, 5), step=0.1).y[:, -1])
            self.assertEqual(many.y.shape[0], 2)
        for wrong in (dict(file="a.h5"), dict(events=rb.Event("q", reset=lambda t, y: y)), dict(quantities={"a": "q"})):
            with self.assertRaises(ValueError):
                rb.integrate(PENDULUM, states, (0, 5), step=0.1, **wrong)

    def test_scan_and_converge(self):
        table = rb.scan("pendulum", {"initial.p": [1.0, 1.5, 1.8]}, until=10)
        self.assertEqual(table["members"], 3)
        self.assertTrue(table.success)
        np.testing.assert_array_equal(np.array(table.members["values/initial.p"], dtype=float), [1.0, 1.5, 1.8])
        self.assertEqual(table.members["last/q"].shape, (3, 1))
        self.assertNotIn("record.h5", str(table))
        file = self.path("scan.h5")
        rb.scan("pendulum", {"initial.p": [1.0, 1.5, 1.8]}, file, until=10)
        np.testing.assert_array_equal(rb.open(file).members["last/q"], table.members["last/q"])
        self.assertEqual(rb.check(file).status, 0)
        stated = rb.scan(PENDULUM, {"initial.p": [1.0, 1.5, 1.8]}, initial=[0, 1], t_span=(0, 10), step=0.1,
                         scheme="midpoint")
        np.testing.assert_array_equal(stated.members["last/q"], table.members["last/q"])
        stated = rb.converge(PENDULUM, initial=[0, 1.9], t_span=(0, 5), step=0.1)
        self.assertLess(abs(stated["quantities"]["q"]["step"]["order"] - 6), 0.5)
        study = rb.converge("pendulum", until=5)
        self.assertTrue(study.success)
        self.assertIn("q", str(study))

    def test_what_does_not_fit_into_memory_is_refused(self):
        chain = rb.Hamiltonian("x[99]", "p[99]", lambda x, p: (p @ p + x @ x) / 2)
        with self.assertRaisesRegex(rb.ProblemError, "memory.*every"):
            rb.integrate(chain, np.ones(198), (0, 1e8), step=1, levels="fixed", scheme="splitting", max_steps=10 ** 9)

    def test_pickles(self):
        r = rb.integrate(PENDULUM, [0, 1.9], (0, 5), step=0.1)
        again = pickle.loads(pickle.dumps(r))
        np.testing.assert_array_equal(again.y, r.y)
        self.assertEqual(again.verdict, r.verdict)
        np.testing.assert_array_equal(again.sol(1.234), r.sol(1.234))
        self.assertEqual(pickle.loads(pickle.dumps(PENDULUM)), PENDULUM)

    def test_results_outlive_their_run(self):
        y = rb.integrate(PENDULUM, [0, 1.9], (0, 5), step=0.1).q
        import gc

        gc.collect()
        junk = [np.ones(1000) for _ in range(100)]
        self.assertEqual(y[0], 0.0)
        self.assertTrue(np.isfinite(y).all() and len(junk) == 100)

    def test_a_lattice_that_begins_from_arrays_is_recorded(self):
        wave = rb.Field(equation="u_tt = u_xx - sin(u)")
        x = -10 + np.arange(101) * (20 / 101)
        line = rb.Lattice(wave, {"x": (-10, 10, 101)}, {"u": np.exp(-x ** 2), "u_t": 0 * x})
        file = self.path("wave.h5")
        rb.integrate(line, (0, 1), step=0.1, file=file)
        self.assertEqual(rb.check(file).status, 0)
        longer = rb.resume(file, 2)
        memory = rb.integrate(line, (0, 2), step=0.1)
        np.testing.assert_array_equal(longer.u, memory.u)
        again = pickle.loads(pickle.dumps(memory))
        np.testing.assert_array_equal(again.u, memory.u)

    def test_planes(self):
        wave = rb.Field("u", lambda u, u_t, u_x, u_y: (u_t ** 2 - u_x ** 2 - u_y ** 2) / 2 - (1 - np.cos(u)))
        grid = {"x": (-5, 5, 21), "y": (-4, 4, 17)}
        traced = rb.Lattice(wave, grid, {"u": lambda x, y: np.exp(-x ** 2 - 2 * y ** 2), "u_t": 0})
        self.assertEqual(traced.shape, (17, 21))
        x, y = traced.coordinates
        arrays = rb.Lattice(wave, grid, {"u": np.exp(-x ** 2 - 2 * y ** 2), "u_t": np.zeros((17, 21))})
        one, other = (rb.integrate(lattice, (0, 0.3), step=0.1) for lattice in (traced, arrays))
        np.testing.assert_allclose(one.u, other.u, atol=1e-12)
        self.assertEqual(one.u.shape[1:], (17, 21))
        self.assertFalse(np.allclose(one.u[0], one.u[0].T[:17, :17].mean()))

    def test_a_lagrangian(self):
        pendulum = rb.Lagrangian("q", lambda q, q_dot: q_dot ** 2 / 2 + np.cos(q))
        r = rb.integrate(pendulum, {"q": 0, "q_dot": 1.9}, (0, 5), step=0.1)
        self.assertEqual(r.y.shape, (2, len(r.t)))
        self.assertEqual(r.q_dot.shape, r.q.shape)
        np.testing.assert_array_equal(r.sol(r.t[3]), r.y[:, 3])
        np.testing.assert_array_equal(r.y[:, 0], [0, 1.9])
        np.testing.assert_array_equal(r.y[1], r.q_dot)
        vectors = rb.Lagrangian("r[2]", lambda r, r_dot: r_dot @ r_dot / 2 - r @ r / 2)
        r = rb.integrate(vectors, [1, 0, 0, 1], (0, 1), step=0.1)
        # Order 6, as of a Hamiltonian: h^6 of .1 is 1e-6, its constant 1/100800; the midpoint rule's error is h^2/12.
        self.assertLess(np.abs(r.r1 - np.cos(r.t)).max(), 1e-9)
        r = rb.integrate(vectors, [1, 0, 0, 1], (0, 1), step=0.1, scheme="midpoint")
        self.assertGreater(np.abs(r.r1 - np.cos(r.t)).max(), 1e-4)

    def test_vectors_are_arrays_of_their_components(self):
        two = rb.Hamiltonian("r[2]", "v[2]", "(v1^2 + v2^2)/2 + (r1^2 + r2^2)/2",
                             invariants={"L": "r1*v2 - r2*v1"})
        r = rb.integrate(two, [1, 0, 0, 1], (0, 1), step=0.1)
        np.testing.assert_array_equal(r.r, r.y[:2])
        np.testing.assert_array_equal(r["v"], r.y[2:])
        self.assertEqual(r.L.shape, r.t.shape)
        many = rb.integrate(two, np.array([[1, 0, 0, 1], [2, 0, 0, 1]]), (0, 1), step=0.1, t_eval=[0, 0.5, 1])
        np.testing.assert_array_equal(many.v, many.y[:, 2:])
        stated = rb.Lagrangian("r[2]", lambda r, r_dot: r_dot @ r_dot / 2 - r @ r / 2)
        r = rb.integrate(stated, [1, 0, 0, 1], (0, 1), step=0.1)
        np.testing.assert_array_equal(r.r_dot, r.y[2:])
        # Names that are numbered otherwise, and a name that is taken, are no vectors.
        plain = rb.Hamiltonian("x1 x3 y1 y", "a b c d", "(a^2 + b^2 + c^2 + d^2)/2 + x1^2 + x3^2 + y1^2 + y^2")
        r = rb.integrate(plain, [1, 0, 0, 1, 0, 0, 0, 0], (0, 1), step=0.1)
        self.assertNotIn("x", r)
        np.testing.assert_array_equal(r["y"], r.y[3])

    def test_velocities_are_read_everywhere(self):
        heavy = rb.Lagrangian("q", lambda q, q_dot: 3 * (q_dot ** 2 / 2 + np.cos(q)))  # p = 3 q'
        light = rb.Hamiltonian("q", "p", lambda q, p: p ** 2 / 2 - np.cos(q))
        how = dict(step=0.01, scheme="gauss", stages=3, events={"top": rb.Event("q", direction=1)})
        r, one = rb.integrate(heavy, [0.1, 1.9], (0, 15), **how), rb.integrate(light, [0.1, 1.9], (0, 15), **how)
        self.assertEqual(len(one.t_events[0]), 1)
        np.testing.assert_allclose(r.y_events[0], one.y_events[0], atol=1e-8)
        np.testing.assert_allclose(r.sol([1.005, 2.5]), one.sol([1.005, 2.5]), atol=1e-8)
        np.testing.assert_allclose(r.p_q, 3 * r.q_dot, rtol=1e-14)
        at = rb.integrate(heavy, [0.1, 1.9], (0, 15), t_eval=[0, 1.005, 2.5], **how)
        np.testing.assert_allclose(at.y, r.sol([0, 1.005, 2.5]), atol=1e-12)
        again = pickle.loads(pickle.dumps(at))
        np.testing.assert_array_equal(again.y, at.y)

    def test_the_state_of_a_driven_system_and_of_one_with_time_scale(self):
        """What was stated is read; the pair of the time, which the run carries, has columns of its own."""
        driven = rb.Hamiltonian("q", "p", lambda q, p, t: p ** 2 / 2 - np.cos(q) + 0.1 * q * np.sin(t))
        scaled = rb.Hamiltonian("x y", "u v", "(u^2 + v^2)/2 - 1/sqrt(x^2 + y^2)", time_scale="sqrt(x^2 + y^2)")
        for system, start, event in ((driven, [0.1, 1.0], "p"), (scaled, [0.4, 0, 0, 2.0], "y")):
            n = len(start)
            r = rb.integrate(system, start, (0, 6), step=0.1, events=event)
            self.assertEqual(r.y.shape, (n, len(r.t)))
            np.testing.assert_array_equal(r.y[:, 0], start)
            np.testing.assert_allclose(r["time"], r.t, rtol=1e-15)
            self.assertEqual(r.y_events[0].shape[0], n)
            np.testing.assert_allclose(r.sol(r.t_events[0]), r.y_events[0], atol=1e-9)
            at = rb.integrate(system, start, (0, 6), step=0.1, t_eval=[0.5, 1.234])
            np.testing.assert_array_equal(r.sol([0.5, 1.234]), at.y)
            steps = list(rb.Integrator(system, start, (0, 6), step=0.1, events=event))
            np.testing.assert_array_equal([step.t for step in steps], r.t[1:])
            np.testing.assert_array_equal(np.array([step.y for step in steps]).T, r.y[:, 1:])
            self.assertEqual([c.t for step in steps for c in step.events], list(r.t_events[0]))
            many = rb.integrate(system, [start, start], (0, 6), step=0.1)
            np.testing.assert_array_equal(many.last[1], r.y[:, -1])
            self.assertEqual(many.t_last[0], r.t[-1])
        kick = rb.Event("p", reset=lambda t, y: [y[0], 0.5])
        r = rb.integrate(driven, [0.1, 1.0], (0, 6), step=0.1, events=kick)
        self.assertEqual(r.resets[0][1].shape, (2,))
        np.testing.assert_allclose(r.sol(r.resets[0][0]), r.resets[0][2])
        orbit = rb.Integrator(driven, [0.1, 1.0], (0, 6), step=0.1, events=kick)
        np.testing.assert_allclose([t for t, *_ in [list(orbit), orbit.resets][1]], [t for t, *_ in r.resets], atol=1e-12)
        with self.assertRaisesRegex(ValueError, "time_scale"):
            rb.integrate(scaled, [0.4, 0, 0, 2.0], (0, 6), step=0.1, events=rb.Event("y", reset=lambda t, y: y))
        with self.assertRaisesRegex(ValueError, "time_scale"):
            rb.Integrator(scaled, [0.4, 0, 0, 2.0], (0, 6), step=0.1).y = [0.4, 0, 0, 2.0]

    def test_resets_of_a_lagrangian(self):
        ball = rb.Lagrangian("x", lambda x, x_dot: 2 * (x_dot ** 2 / 2 - x))
        floor = rb.Event("x", direction=-1, reset=lambda t, y: [0.0, -0.9 * y[1]])
        r = rb.integrate(ball, [1, 0], (0, 6), step=0.01, events={"floor": floor})
        self.assertGreaterEqual(len(r.resets), 2)
        np.testing.assert_allclose(r.resets[0][0], np.sqrt(2), atol=1e-4)
        np.testing.assert_allclose(r.energies[1] / r.energies[0], 0.81, atol=1e-3)
        self.assertGreaterEqual(r.x.min(), -1e-9)
        self.assertIn("reset", r.message)
        t = r.resets[0][0]
        np.testing.assert_allclose(r.sol(t), r.resets[0][2], atol=1e-12)
        np.testing.assert_allclose(r.sol([t - 1e-9, t + 1e-9])[1], [-np.sqrt(2), 0.9 * np.sqrt(2)], atol=1e-4)
        self.assertEqual(r.y.shape, (2, len(r.t)))
        np.testing.assert_array_equal(r.x_dot, r.y[1])

    def test_a_moving_frame(self):
        wave = rb.Field(equation="u_tt = u_xx - sin(u)")
        hump_of = {"u": lambda x: np.exp(-x ** 2), "u_t": lambda x: x * np.exp(-x ** 2)}
        hump = rb.Lattice(wave, {"x": (-20, 20, 101)}, hump_of)
        r = rb.integrate(hump, (0, 2), step=0.05, levels="fixed", frame={"velocity": 0.5})
        np.testing.assert_allclose(r.shift(), 0.5 * r.t, rtol=1e-14)
        np.testing.assert_array_equal(r.to_xarray().x_shift, r.shift())
        self.assertTrue(r.plot("map").has_data())

        def states(cells, **how):
            line = rb.Lattice(wave, {"x": (-20, 20, cells)}, hump_of)
            return rb.integrate(line, (0, 2), step=20 / cells, levels="fixed", t_eval=[1, 2], **how)

        self.assertIsNone(states(101).shift())
        self.assertIsNone(states(101, frame={"velocity": 0.5}).shift())
        # Both are of the laboratory: they differ by errors of order 2.
        apart = [np.abs(states(cells).u - states(cells, frame={"velocity": 0.5}).u).max() for cells in (201, 603)]
        self.assertLess(apart[1], apart[0] / 6)
        with self.assertRaisesRegex(ValueError, "moving frame"):
            rb.Integrator(hump, (0, 2), step=0.05, frame={"velocity": 0.5}).u = np.zeros(101)

    def test_a_jump(self):
        wave = rb.Field(equation="u_tt = u_xx - sin(u)")

        def kink(jump, cells=301):
            grid = {"x": {"from": -15, "to": 15, "cells": cells, "jump": {"u": jump}}}
            return rb.Lattice(wave, grid, {"u": lambda x: 4 * np.arctan(np.exp(x)), "u_t": lambda x: 0 * x})

        r = rb.integrate(kink("2*pi"), (0, 2), step=0.1)
        self.assertTrue(r.success)
        # The kink rests, but for the error of order 2 of its shape and tails of exp(-15) at the seam.
        np.testing.assert_allclose(r.u[-1], r.u[0], atol=5e-3)
        self.assertGreater(r.u[-1].max() - r.u[-1].min(), 6.2)
        self.assertIn("momentum_max", r.laws)
        by_hand = rb.Integrator(kink("2*pi"), (0, 2), step=0.1)
        by_hand.step()
        np.testing.assert_array_equal(by_hand.u, r.u[1])
        by_hand.u = by_hand.u
        by_hand.step()
        np.testing.assert_allclose(by_hand.u, r.u[2], atol=1e-4)
        # The twin: a jump that S does not have.
        with self.assertRaisesRegex(ValueError, "S has to be the same"):
            rb.integrate(kink(3), (0, 2), step=0.1)

    def test_a_phase(self):
        wave = rb.Field(equation="i*psi_t + psi_xx - abs2(psi)*psi = 0", psi=["p", "q"])

        def plane(phase, k=1.3, cells=40):
            grid = {"x": {"from": 0, "to": 5, "cells": cells, "phase": {"psi": phase}}}
            return rb.Lattice(wave, grid, {"p": lambda x: np.cos(k * x), "q": lambda x: np.sin(k * x)})

        r = rb.integrate(plane(1.3 * 5), (0, 1), step=0.01, scheme="fourier")
        self.assertTrue(r.success)
        x = np.arange(40) / 8
        # The error of the step is (omega h)^2/12 of omega t, omega = k^2 + 1.
        exact = np.exp(1j * (1.3 * x - (1.3**2 + 1) * r.t[-1]))
        np.testing.assert_allclose(r.p[-1] + 1j * r.q[-1], exact, atol=1e-3)
        by_hand = rb.Integrator(plane(1.3 * 5), (0, 1), step=0.01, scheme="fourier")
        by_hand.step()
        np.testing.assert_array_equal(by_hand.p, r.p[1])
        # The twin: psi does not turn, so that the data are torn.
        torn = rb.integrate(plane(0), (0, 1), step=0.01, scheme="splitting")
        self.assertGreater(np.abs(torn.p[-1] + 1j * torn.q[-1] - exact).max(), 0.1)
        with self.assertRaisesRegex(ValueError, "twice the ring"):
            rb.integrate(rb.Lattice(rb.Field(equation="u_tt = u_xx - sin(u)"),
                                    {"x": {"from": 0, "to": 5, "cells": 40, "phase": {"u": "pi"}}},
                                    {"u": lambda x: 0 * x, "u_t": lambda x: 0 * x}), (0, 1), step=0.1)

    def test_a_sponge(self):
        wave = rb.Field(equation="u_tt = u_xx")
        grid = {"x": {"from": -15, "to": 15, "cells": 201, "sponge": {"width": 8, "strength": 1.5}}}
        packet = {"u": lambda x: np.exp(-x**2 / 4) * np.cos(np.pi * x), "u_t": lambda x: 0 * x}
        r = rb.integrate(rb.Lattice(wave, grid, packet), (0, 30), step=0.1, scheme="fourier")
        self.assertTrue(r.success)
        self.assertGreater(np.abs(r.u[0]).max(), 0.95)
        self.assertLess(np.abs(r.u[-1]).max(), 1e-2)
        self.assertGreater(r.figures["sponge"]["energy_lost"], 0.99 * r.H[0])
        with self.assertRaisesRegex(ValueError, "half of"):
            rb.integrate(rb.Lattice(wave, {"x": {**grid["x"], "sponge": {"width": 15, "strength": 1}}},
                                    packet), (0, 1), step=0.1)

    def test_walls(self):
        wave = rb.Field(equation="u_tt = u_xx - u")
        grid = {"x": {"from": 0, "to": 1, "cells": 32, "left": "fixed", "right": "free"}}

        def string(u):
            return rb.Lattice(wave, grid, {"u": u, "u_t": lambda x: 0 * x})

        k = np.pi / 2
        line = string(lambda x: np.sin(np.asarray(x) * k))
        self.assertEqual(line.shape, (33,))
        r = rb.integrate(line, (0, 1), step=0.02, scheme="fourier", levels="fixed")
        self.assertTrue(r.success)
        np.testing.assert_allclose(r["x"], np.linspace(0, 1, 33), atol=1e-15)
        # The midpoint rule turns the wave by an angle that is off by (omega h)^2/12 of itself.
        omega = np.sqrt(1 + k**2)
        np.testing.assert_allclose(r.u[-1], np.sin(k * r["x"]) * np.cos(omega * r.t[-1]), atol=2 * (0.02 * omega)**2 / 12)
        self.assertIn("momentum_balance_max", r.laws)
        # The twin: a string that its wall does not hold.
        with self.assertRaisesRegex(ValueError, "meet the wall"):
            rb.integrate(string(lambda x: np.cos(np.asarray(x) * k)), (0, 1), step=0.02, scheme="fourier")

    def test_lattices(self):
        r = rb.run("sine-gordon", until=0.5)
        self.assertIn("energy_max", r.laws)
        self.assertEqual(r.u.shape[0], len(r.t))
        self.assertEqual(r["x"].shape[0], r.u.shape[1])
        self.assertIn("good", r._repr_html_())
        for name, words in (("y", "fields by name"), ("sol", "t_eval"), ("yy", "has no 'yy'")):
            with self.assertRaisesRegex(AttributeError, words):
                getattr(r, name)
        with self.assertRaisesRegex(AttributeError, "leave out every"):
            rb.integrate(PENDULUM, [0, 1.9], (0, 5), step=0.1, every=3).sol

    def test_the_verdict_of_a_solution_is_by_half_the_step(self):
        pendulum = rb.Hamiltonian("q", "p", "p^2/2 - cos(q)")
        conditions = {"ends": "periodic", "energy": -0.5}
        how = {"initial": [1, 0], "t_span": (0, 6.7), "scheme": "midpoint"}
        coarse, fine = (rb.solve(pendulum, conditions, step=step, **how) for step in (1.675, 0.1))
        self.assertEqual((coarse.verdict, fine.verdict), ("doubtful", "good"))
        self.assertEqual(coarse.reasons[0]["what"], "resolution")
        self.assertLess(fine.figures["solution"]["step_error"]["relative"], 0.01)

    def test_periodic_lattices(self):
        omega = 0.9
        gamma, period = np.sqrt(1 - omega ** 2), 2 * np.pi / omega
        wave = rb.Field(equation="u_tt = u_xx - sin(u)")
        line = rb.Lattice(wave, {"x": (-10, 10, 51)}, {"u": 0, "u_t": lambda x: 4 * gamma * rb.sech(gamma * x)})
        how = {"t_span": (0, period), "step": period / 40, "levels": "fixed", "scheme": "box"}
        found, guess = rb.solve(line, {"ends": "periodic"}, **how), rb.run(line, **how)
        self.assertTrue(found.success)
        self.assertLess(found.solution["residual"][-1], 1e-12)
        closes = [np.abs(r["u"][-1] - r["u"][0]).max() for r in (found, guess)]
        self.assertLess(closes[0], 1e-9)
        self.assertGreater(closes[1], 1e-4)  # twin: the guess
        none = rb.solve(line, {"ends": "periodic", "energy": -3, "max_iterations": 5}, **how)
        self.assertFalse(none.success)
        self.assertIn("the energy", none.message)
        with self.assertRaisesRegex(ValueError, "levels = \"fixed\""):
            rb.solve(line, {"ends": "periodic"}, **{**how, "levels": "variable"})

    def test_tangents(self):
        r = rb.run("henon-heiles", tangents={"vectors": "all", "matrix": True}, until=20)
        self.assertEqual(r.lyapunov.growth.shape, (4, len(r.h)))
        np.testing.assert_allclose(r.lyapunov.exponents, r.lyapunov.growth.sum(axis=1) / (r.t[-1] - r.t[0]), rtol=1e-12)
        self.assertLess(abs(r.lyapunov.exponents.sum()), 1e-14)
        self.assertLess(r.lyapunov.two_form.max(), 1e-14)
        matrix = r.tangent
        self.assertEqual(matrix.shape, (len(r.t), 4, 4))
        J = np.block([[np.zeros((2, 2)), np.eye(2)], [-np.eye(2), np.zeros((2, 2))]])
        self.assertLess(abs(matrix[-1].T @ J @ matrix[-1] - J).max(), 1e-12 * abs(matrix[-1]).max() ** 2)
        with self.assertRaisesRegex(LookupError, "parameters"):
            r.sensitivities
        by = rb.run("pendulum", tangents=1, until=5)
        self.assertIsNone(by.lyapunov.two_form)
        self.assertEqual(len(rb.run("henon-heiles", tangents=True, until=5).lyapunov.exponents), 2)
        with self.assertRaisesRegex(LookupError, "tangents=4"):
            rb.run("pendulum", until=5).lyapunov
        one = rb.integrate(rb.Hamiltonian("q", "p", "p^2/2 + k*q^2/2", parameters={"k": 2.0}), [0, 1], (0, 3), step=0.1,
                           levels="fixed", tangents={"parameters": ["k"]}).sensitivities["k"]
        self.assertEqual(one.shape, (2, 31))

    @unittest.skipUnless(importlib.util.find_spec("xarray"), "xarray is not installed")
    def test_xarray(self):
        plane = rb.run("sine-gordon-2d", settings=["grid.x.cells=15", "grid.y.cells=13"], until=0.1).to_xarray()
        self.assertEqual(plane.u.dims, ("t", "y", "x"))
        self.assertEqual(plane.u.shape[1:], (13, 15))
        orbit = rb.run("kepler", until=2).to_xarray()
        self.assertEqual(len(orbit.data_vars), 4)
        driven = rb.Hamiltonian("q", "p", lambda q, p, t: p ** 2 / 2 + q * np.sin(t))
        self.assertEqual(list(rb.integrate(driven, [0, 1], (0, 1), step=0.1).to_xarray().data_vars), ["q", "p"])

    def test_warnings_name_the_line_of_the_caller(self):
        kepler = rb.Hamiltonian("x y", "u v", "(u^2 + v^2)/2 - 1/sqrt(x^2 + y^2)")
        turn = rb.Event("y", terminal=9, reset=lambda t, y: None)
        calls = [lambda: rb.integrate(kepler, [0.2, 0, 0, 3], (0, 5), step=0.01),
                 lambda: rb.integrate(kepler, [0.2, 0, 0, 3], (0, 5), step=0.01, events=turn),
                 lambda: rb.integrate(kepler, [[0.2, 0, 0, 3]] * 2, (0, 5), step=0.01)]
        for call in calls:
            with warnings.catch_warnings(record=True) as caught:
                warnings.simplefilter("always")
                call()
            self.assertGreater(len(caught), 0)
            for warning in caught:
                self.assertEqual(warning.filename, __file__)
                self.assertIs(warning.category, rb.RubatoWarning)

    def test_a_result_that_is_not_good_says_so_at_once_and_one_that_is_says_nothing(self):
        line = rb.Lattice(rb.Field("u_tt = u_xx - sin(u)"), {"x": (-20, 20, 41)},
                          {"u": lambda x: np.exp(-x ** 2), "u_t": 0})
        with self.assertWarnsRegex(rb.RubatoWarning, "^(doubtful|lost): the spectrum is full.*; take more cells"):
            self.assertNotEqual(rb.integrate(line, (0, 1), step=0.1, scheme="fourier").verdict, "good")
        oscillator = rb.Hamiltonian("q", "p", "(p^2 + q^2)/2")
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            self.assertEqual(rb.integrate(oscillator, [1, 0], (0, 5), step=0.1).verdict, "good")


if __name__ == "__main__":
    unittest.main()
