"""Stepping by hand, interruption, threads."""

import os
import shutil
import signal
import subprocess
import sys
import tempfile
import threading
import time
import unittest
import warnings

import numpy as np

import rubato as rb

KEPLER = rb.Hamiltonian("x y", "u v", "(u^2 + v^2)/2 - 1/sqrt(x^2 + y^2)")
START = [0.4, 0, 0, 2]
WAVE = rb.Field(equation="u_tt = u_xx - sin(u)")


def setUpModule():
    warnings.simplefilter("ignore", rb.RubatoWarning)


class Steps(unittest.TestCase):
    def test_steps_are_those_of_integrate(self):
        r = rb.integrate(KEPLER, START, (0, 5), step=0.02)
        orbit = rb.Integrator(KEPLER, START, (0, 5), step=0.02)
        steps = list(orbit)
        np.testing.assert_array_equal([step.t for step in steps], r.t[1:])
        np.testing.assert_array_equal(np.array([step.y for step in steps]).T, r.y[:, 1:])
        np.testing.assert_array_equal([step.energy for step in steps], r.energy)
        np.testing.assert_array_equal([step.h for step in steps], r.h)
        self.assertTrue(orbit.finished)
        self.assertEqual(orbit.steps, len(steps))
        np.testing.assert_array_equal(orbit.y, r.y[:, -1])
        self.assertEqual(list(orbit), [])

    def test_a_state_that_is_assigned(self):
        orbit = rb.Integrator(KEPLER, START, (0, 50), step=0.02)
        before = next(orbit)
        energy = before.energy
        orbit.y = orbit.y * [1, 1, 1.1, 1.1]
        after = next(orbit)
        self.assertGreater(abs(after.energy - energy), 1e-3)
        self.assertLess(abs(next(orbit).energy - after.energy), 1e-13)
        self.assertAlmostEqual(after.t - before.t, before.h, delta=0.1 * before.h)
        orbit["x"] = 0.5
        self.assertEqual(orbit["x"], 0.5)
        for wrong in ([1, 2], "abcd", [1, 2, 3, np.nan], None):
            with self.assertRaises((ValueError, TypeError)):
                orbit.y = wrong
        self.assertEqual(orbit["x"], 0.5)

    def test_states_within_the_last_step(self):
        orbit = rb.Integrator(KEPLER, START, (0, 5), step=0.02)
        first = next(orbit)
        np.testing.assert_array_equal(orbit.state_at(first.t), first.y)
        middle = orbit.state_at(first.t - first.h / 2)
        self.assertTrue(np.isfinite(middle).all())
        with self.assertRaises(ValueError):
            orbit.state_at(first.t + first.h)

    def test_a_lattice(self):
        line = rb.Lattice(WAVE, {"x": (-10, 10, 101)}, {"u": lambda x: 0.5 * rb.sech(x), "u_t": 0})
        r = rb.integrate(line, (0, 1), step=0.1)
        steps = rb.Integrator(line, (0, 1), step=0.1)
        for step in steps:
            pass
        np.testing.assert_array_equal(steps["u"], r.u[-1])
        with self.assertRaisesRegex(AttributeError, "fields by name"):
            steps.y
        with self.assertRaisesRegex(AttributeError, "fields by name"):
            step.y
        again = rb.Integrator(line, (0, 1), step=0.1)
        next(again)
        again["u"] = again["u"] * 0
        self.assertEqual(np.abs(again["u"]).max(), 0)
        next(again)
        self.assertGreater(np.abs(again["u"]).max(), 0)

    def test_objects_keep_what_they_need(self):
        import gc

        step = next(rb.Integrator(KEPLER, START, (0, 5), step=0.02))
        sol = rb.integrate(KEPLER, START, (0, 5), step=0.02).sol
        gc.collect()
        self.assertEqual(step.y.shape, (4,))
        self.assertTrue(np.isfinite(sol(1.0)).all())

    def test_two_threads(self):
        alone = rb.integrate(KEPLER, START, (0, 50), step=0.02)
        found = {}

        def work(number):
            steps = [step.y for step in rb.Integrator(KEPLER, START, (0, 50), step=0.02)]
            found[number] = np.array(steps).T

        threads = [threading.Thread(target=work, args=(i,)) for i in range(2)]
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join()
        for states in found.values():
            np.testing.assert_array_equal(states, alone.y[:, 1:])

    def test_an_integrator_is_for_one_thread_at_a_time(self):
        line = rb.Lattice(WAVE, {"x": (-10, 10, 20001)}, {"u": lambda x: 0.5 * rb.sech(x), "u_t": 0})
        steps = rb.Integrator(line, (0, 1), step=5e-4, scheme="leapfrog", levels="fixed")
        refused, states = [], []

        def work():
            try:
                for _ in range(200):
                    next(steps)
                    states.append(steps["u"][0])
            except RuntimeError as error:
                refused.append(str(error))

        threads = [threading.Thread(target=work) for _ in range(4)]
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join()
        self.assertTrue(np.isfinite(states).all())
        for words in refused:
            self.assertIn("another thread", words)
        self.assertGreater(len(states), 0)
        self.assertTrue(np.isfinite(next(steps).energy))

    def test_ctrl_c_ends_an_ensemble(self):
        pendulum = rb.Hamiltonian("q", "p", "p^2/2 - cos(q)")
        states = np.column_stack([np.zeros(2000), np.linspace(0.1, 1.9, 2000)])
        timer = threading.Timer(0.5, os.kill, (os.getpid(), signal.SIGINT))
        timer.start()
        try:
            with self.assertRaises(KeyboardInterrupt):
                for _ in range(10000):
                    rb.integrate(pendulum, states, (0, 100), step=0.1, scheme="splitting", levels="fixed")
        finally:
            timer.join()

    def test_ctrl_c_is_heard_within_members(self):
        """They are too long to come to their ends: what was computed of them is in the result."""
        pendulum = rb.Hamiltonian("q", "p", "p^2/2 - cos(q)")
        states = np.column_stack([np.zeros(200), np.linspace(0.1, 1.9, 200)])
        for how in (dict(scheme="splitting"), dict(scheme="midpoint")):
            wait, begun = 0.1, np.array(False)
            while not begun.any():  # until some have begun by then
                timer = threading.Timer(wait, os.kill, (os.getpid(), signal.SIGINT))
                timer.start()
                try:
                    rb.integrate(pendulum, states, (0, 1e8), step=0.1, levels="fixed", max_steps=10**12, **how)
                except rb.Interrupted as interrupted:
                    many = interrupted.result
                    begun = many.steps > 0
                except KeyboardInterrupt:  # before the members
                    pass
                finally:
                    timer.join()
                wait *= 2
            self.assertTrue((many.status == 130).all())
            self.assertTrue(np.isfinite(many.last[begun]).all())
            self.assertEqual(set(many.verdicts) - {"", "good"}, set())  # and none of them is run again
            m = int(np.flatnonzero(begun)[0])
            np.testing.assert_allclose(many.t[m], 0.1 * many.steps[m], rtol=1e-12)

    def test_ctrl_c_leaves_the_members_that_were_done(self):
        pendulum = rb.Hamiltonian("q", "p", "p^2/2 - cos(q)")
        states = np.column_stack([np.zeros(100000), np.linspace(0.1, 1.9, 100000)])

        def press(done, members):
            if not pressed:
                pressed.append(done)
                os.kill(os.getpid(), signal.SIGINT)

        for how in (dict(scheme="splitting", levels="fixed"), dict(t_eval=[0, 10])):
            pressed = []
            with self.assertRaises(rb.Interrupted) as caught:
                rb.integrate(pendulum, states, (0, 10), step=0.1, progress=press, **how)
            many = caught.exception.result
            self.assertEqual(len(many), len(states))
            self.assertGreater((many.status == 0).sum(), 0)
            self.assertGreater((many.status == 130).sum(), 0)
            self.assertTrue(np.isfinite(many.last[many.status == 0]).all())

    def test_ctrl_c_ends_a_replay(self):
        """Before half of it is over, by the processor's time: another thread waits until it is under way."""
        with tempfile.TemporaryDirectory() as folder:
            file = os.path.join(folder, "long.h5")
            rb.integrate(KEPLER, START, (0, 2000), step=0.002, every=1000, file=file, scheme="splitting", levels="fixed")
            begun = time.process_time()
            rb.check(file)
            alone = time.process_time() - begun
            begun = time.process_time()
            rb.check(file, replay=True)
            whole = time.process_time() - begun
            pressed = []

            def press():
                pressed.append(time.monotonic())
                os.kill(os.getpid(), signal.SIGINT)

            timer = threading.Timer(alone + (whole - alone) / 4, press)
            timer.start()
            try:
                with self.assertRaises(KeyboardInterrupt):
                    for _ in range(1000):
                        rb.check(file, replay=True)
                self.assertLess(time.monotonic() - pressed[0], max(1.0, (whole - alone) / 2))
            finally:
                timer.join()

    def test_ctrl_c_ends_a_check(self):
        with tempfile.TemporaryDirectory() as folder:
            file = os.path.join(folder, "long.h5")
            rb.integrate(KEPLER, START, (0, 200), step=0.01, file=file)
            timer = threading.Timer(0.2, os.kill, (os.getpid(), signal.SIGINT))
            timer.start()
            try:
                with self.assertRaises(KeyboardInterrupt):
                    for _ in range(10000):
                        rb.check(file)
            finally:
                timer.join()
            self.assertEqual(rb.check(file).status, 0)

    def test_the_lock_is_released(self):
        """Another thread goes on while a run lasts."""
        counted = []
        done = threading.Event()

        def count():
            while not done.is_set():
                counted.append(1)
                time.sleep(0.001)

        thread = threading.Thread(target=count)
        thread.start()
        try:
            while not counted:
                time.sleep(0.001)
            for _ in range(1000):  # until the system lets the other thread run during one of them
                before = len(counted)
                rb.integrate(KEPLER, START, (0, 500), step=0.02, every=1000)
                if len(counted) > before:
                    break
            else:
                self.fail("the other thread stood still")
        finally:
            done.set()
            thread.join()

    def test_ctrl_c_leaves_what_was_computed(self):
        def press(t, end):
            if not pressed:
                pressed.append(t)
                os.kill(os.getpid(), signal.SIGINT)

        pressed = []
        with self.assertRaises(rb.Interrupted) as caught:
            rb.integrate(KEPLER, START, (0, 1e9), step=0.02, every=100000, progress=press)
        r = caught.exception.result
        self.assertGreater(r.t[-1], 0)
        self.assertEqual(r.status, 130)
        self.assertFalse(r.success)
        self.assertIsInstance(caught.exception, KeyboardInterrupt)
        with tempfile.TemporaryDirectory() as folder:
            file = os.path.join(folder, "half.h5")
            pressed.clear()
            with self.assertRaises(rb.Interrupted):
                rb.integrate(KEPLER, START, (0, 1e9), step=0.02, every=100000, progress=press, file=file)
            half = rb.open(file)
            self.assertEqual((half.success, half.status), (False, 130))
            self.assertIn("resume", half.message)
            self.assertIn(f"{half.figures['steps']} steps", repr(half))
        self.assertTrue(rb.integrate(KEPLER, START, (0, 1), step=0.02).success)  # the next one is not interrupted
        pressed.clear()
        with self.assertRaises(rb.Interrupted) as caught:
            rb.converge("pendulum", until=1e9, every=100000, progress=press)
        self.assertEqual(caught.exception.result.status, 130)
        pressed.clear()
        with self.assertRaises(rb.Interrupted) as caught:
            rb.scan("pendulum", {"initial.p": [1.0, 1.5]}, until=1e9, progress=press)
        self.assertNotIn("resume", caught.exception.result.message)

    def test_ctrl_c_ends_a_search(self):
        # A search of minutes, that the first iterations are interrupted of.
        key = threading.Timer(0.5, os.kill, (os.getpid(), signal.SIGINT))
        key.start()
        with self.assertRaises(rb.Interrupted) as caught:
            rb.solve("pendulum", {"ends": "periodic", "energy": 0.9}, settings=["initial.p=1.9"], until=63, step=1e-4)
        self.assertEqual(caught.exception.result.status, 130)

    def test_what_a_callback_raises(self):
        def fail(t, end):
            raise RuntimeError("of the callback")

        with self.assertRaisesRegex(RuntimeError, "of the callback"):
            rb.integrate(KEPLER, START, (0, 1e9), step=0.02, every=100000, progress=fail)


class Crossings(unittest.TestCase):
    BALL = rb.Hamiltonian("x", "v", "v^2/2 + x")

    def test_steps_have_the_crossings_of_integrate(self):
        events = {"up": rb.Event("y", direction=1, quantities=["x", "u"]), "far": rb.Event("x < -1.5")}
        r = rb.integrate(KEPLER, START, (0, 20), step=0.02, events=events)
        found = [crossing for step in rb.Integrator(KEPLER, START, (0, 20), step=0.02, events=events)
                 for crossing in step.events]
        self.assertGreater(len(found), 4)
        for name, crossings in r.events.items():
            mine = [crossing for crossing in found if crossing.name == name]
            np.testing.assert_array_equal([crossing.t for crossing in mine], crossings.t)
            np.testing.assert_array_equal([crossing.direction for crossing in mine], crossings.direction)
            np.testing.assert_array_equal(np.array([crossing.y for crossing in mine]).T, crossings.y)
        np.testing.assert_array_equal([c.quantities for c in found if c.name == "up"], r.events["up"].quantities)

    def test_a_terminal_event_ends_the_steps(self):
        orbit = rb.Integrator(KEPLER, START, (0, 1000), step=0.02, events={"far": rb.Event("y", terminal=3)})
        steps = list(orbit)
        self.assertEqual(sum(len(step.events) for step in steps), 3)
        self.assertEqual(len(steps[-1].events), 1)
        self.assertEqual(orbit.stopped, "far")
        self.assertTrue(orbit.finished)
        r = rb.integrate(KEPLER, START, (0, 1000), step=0.02, events={"far": rb.Event("y", terminal=3)})
        self.assertEqual(steps[-1].t, r.t[-1])
        self.assertEqual(rb.Integrator(KEPLER, START, (0, 1), step=0.02).stopped, "")

    def test_a_ball_bounces(self):
        bounce = rb.Event("x", direction=-1, reset=lambda t, y: [0, -0.9 * y[1]])
        ball = rb.Integrator(self.BALL, [1, 0], (0, 6), step=0.01, levels="fixed", events={"floor": bounce})
        steps = list(ball)
        r = rb.integrate(self.BALL, [1, 0], (0, 6), step=0.01, levels="fixed", events={"floor": bounce})
        self.assertEqual(len(ball.resets), len(r.resets))
        np.testing.assert_allclose([t for t, *_ in ball.resets], [t for t, *_ in r.resets], atol=1e-12)
        np.testing.assert_allclose(ball.resets[0][0], np.sqrt(2), atol=1e-9)
        at = [step for step in steps if step.events]
        self.assertEqual([step.t for step in at], [t for t, *_ in ball.resets])
        np.testing.assert_array_equal([step.y for step in at], [before for _, before, _ in ball.resets])
        self.assertGreaterEqual(min(step.y[0] for step in steps), -1e-9)
        self.assertTrue((np.diff([step.t for step in steps]) > 0).all())
        after = steps[steps.index(at[0]) + 1]
        self.assertAlmostEqual(after.energy / at[0].energy, 0.81, delta=1e-9)

    def test_bounces_that_accumulate_are_warned_of(self):
        bounce = rb.Event("x", direction=-1, reset=lambda t, y: [0, -0.5 * y[1]])
        ball = rb.Integrator(self.BALL, [1, 0], (0, 6), step=0.05, levels="fixed", events={"floor": bounce})
        with self.assertWarnsRegex(rb.RubatoWarning, "event floor starts at its zero and has returned"):
            list(ball)
        once = rb.Integrator(self.BALL, [1, 0], (0, 3), step=0.05, levels="fixed", events={"floor": bounce})
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            list(once)

    def test_a_reset_may_end_the_steps_or_fail(self):
        once = rb.Integrator(self.BALL, [1, 0], (0, 6), step=0.01, events={"floor": rb.Event("x", reset=lambda t, y: None)})
        self.assertAlmostEqual(list(once)[-1].t, np.sqrt(2), delta=1e-9)
        self.assertEqual(once.stopped, "floor")
        self.assertEqual(once.resets, [])
        for wrong in (lambda t, y: [1], lambda t, y: 1 / 0, lambda t, y: [np.nan, 0]):
            ball = rb.Integrator(self.BALL, [1, 0], (0, 6), step=0.01, events={"floor": rb.Event("x", reset=wrong)})
            with self.assertRaises((ValueError, TypeError, ZeroDivisionError)):
                list(ball)

    def test_a_lagrangian(self):
        stated = rb.Lagrangian("x", lambda x, x_dot: 2 * (x_dot ** 2 / 2 - x))  # its momentum is twice its velocity
        bounce = rb.Event("x", direction=-1, reset=lambda t, y: [0, -0.9 * y[1]])
        ball = rb.Integrator(stated, [1, 0], (0, 6), step=0.01, events={"floor": bounce})
        steps = list(ball)
        self.assertEqual(len(ball.resets), 2)
        np.testing.assert_allclose(ball.resets[0][1], [0, -np.sqrt(2)], atol=1e-4)
        np.testing.assert_array_equal(ball.resets[0][2][1], -0.9 * ball.resets[0][1][1])
        np.testing.assert_allclose(steps[-1].p, 2 * steps[-1].y[1:], rtol=1e-14)
        ball = rb.Integrator(stated, [1, 0], (0, 6), step=0.01)
        np.testing.assert_allclose(ball.y, [1, 0])
        ball.y = [2, 3]
        np.testing.assert_allclose(ball.y, [2, 3])
        ball.x_dot = -3
        self.assertAlmostEqual(ball["x_dot"], -3)
        next(ball)
        self.assertLess(ball.x, 2)

    def test_on_a_lattice(self):
        line = rb.Lattice(WAVE, {"x": (-10, 10, 101)}, {"u": lambda x: 0.5 * rb.sech(x), "u_t": 0})
        middle = rb.Event("u", at={"x": 0}, terminal=True)
        r = rb.integrate(line, (0, 10), step=0.1, events={"middle": middle})
        steps = list(rb.Integrator(line, (0, 10), step=0.1, events={"middle": middle}))
        self.assertEqual(steps[-1].t, r.t[-1])
        self.assertEqual(steps[-1].events[0].t, r.t_events[0][0])
        for function in (rb.integrate, rb.Integrator):
            with self.assertRaisesRegex(ValueError, "lattice.*assign the fields"):
                function(line, (0, 10), step=0.1, events=rb.Event("u", at={"x": 0}, reset=lambda t, y: y))

    def test_names(self):
        orbit = rb.Integrator(KEPLER, START, (0, 5), step=0.02)
        self.assertEqual(orbit.x, 0.4)
        orbit.x = 0.5
        self.assertEqual(orbit.y[0], 0.5)
        with self.assertRaisesRegex(AttributeError, "steps"):
            orbit.stps
        with self.assertRaisesRegex(AttributeError, "no 'Y'"):
            orbit.Y = [1, 2, 3, 4]


class Bar(unittest.TestCase):
    """Progress is shown of what takes longer than a second."""

    def bar(self, modules):
        from unittest import mock

        from rubato import _run

        with mock.patch.dict(sys.modules, modules):
            bar = _run._Bar(True)
        bar.begun -= 2.0
        return bar

    def test_in_a_terminal(self):
        import contextlib
        import io

        with contextlib.redirect_stderr(io.StringIO()) as printed:
            bar = self.bar({})
            bar(2.5, 0.0, 10.0, 17, 0)
            self.assertIn("25.0 %", printed.getvalue())
            self.assertIn("17 steps, 6 s left", printed.getvalue())
            bar(30, 0, 0, 0, 40)
            self.assertIn("30 of 40 members", printed.getvalue())
            bar.close()
            self.assertTrue(printed.getvalue().endswith("\r\x1b[K"))
        with contextlib.redirect_stderr(io.StringIO()) as printed:
            short = self.bar({})
            short.begun = time.monotonic()
            short(2.5, 0.0, 10.0, 17, 0)
            short.close()
            self.assertEqual(printed.getvalue(), "")

    def test_in_a_notebook(self):
        import types

        shown = []

        class Handle:
            def update(self, bar):
                shown.append(bar)

        def display(bar, display_id):
            shown.append(bar)
            return Handle()

        module = types.ModuleType("IPython.display")
        module.HTML, module.display = str, display
        from unittest import mock

        with mock.patch.dict(sys.modules, {"IPython": types.ModuleType("IPython"), "IPython.display": module}):
            bar = self.bar({"ipykernel": types.ModuleType("ipykernel")})
            bar(2.5, 0.0, 10.0, 17, 0)
            bar(5.0, 0.0, 10.0, 34, 0)
            bar.close()
        self.assertEqual(len(shown), 3)
        self.assertIn('value="0.2500"', shown[0])
        self.assertIn('value="0.5000"', shown[1])
        self.assertEqual(shown[2], "")


PROGRAM = """
import locale, sys
import numpy as np, rubato as rb
locale.setlocale(locale.LC_ALL, sys.argv[1])
comma = locale.localeconv()["decimal_point"]
kepler = rb.Hamiltonian("x y", "u v", lambda x, y, u, v: (u**2 + v**2)/2 - 1.0/np.sqrt(x**2 + y**2 + 0.0625))
r = rb.integrate(kepler, [0.4, 0, 0, 2.0], (0, 1.5), step=0.02, quantities={"half": "x*0.5"})
figures = r.figures
del figures["wall_seconds"]
print(comma, r.y.tobytes().hex(), r.half.tobytes().hex(), kepler.text, figures)
"""


class Locale(unittest.TestCase):
    @unittest.skipUnless(shutil.which("localedef") and os.path.exists("/usr/share/i18n/locales/de_DE"),
                         "there is no locale de_DE")
    def test_a_decimal_comma_changes_nothing(self):
        with tempfile.TemporaryDirectory() as folder:
            subprocess.run(["localedef", "-i", "de_DE", "-f", "UTF-8", os.path.join(folder, "de_DE.UTF-8")], check=True)
            printed = [subprocess.run([sys.executable, "-c", PROGRAM, name], env=dict(os.environ, LOCPATH=folder),
                                      capture_output=True, text=True, check=True).stdout
                       for name in ("C", "de_DE.UTF-8")]
        self.assertEqual(printed[0][0], ".")
        self.assertEqual(printed[1][0], ",")
        self.assertEqual(printed[0][1:], printed[1][1:])


if __name__ == "__main__":
    unittest.main()
