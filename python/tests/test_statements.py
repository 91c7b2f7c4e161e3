"""Systems stated by functions, texts and SymPy expressions are the same problem."""

import importlib.util
import unittest

import numpy as np

import rubato as rb


class Tracing(unittest.TestCase):
    def formula(self, function, names="x y"):
        momenta = " ".join("p" + name for name in names.split())
        return rb.Hamiltonian(names, momenta, function)._tables["hamiltonian"]["H"]

    def test_operators_keep_their_order(self):
        x, y, z = rb.symbols("x y z")
        for symbol, text in [
            (x - (y - z), "x - (y - z)"),
            (x - y - z, "x - y - z"),
            ((x + y) * z, "(x + y)*z"),
            (x / (y * z), "x/(y*z)"),
            (x / y * z, "x/y*z"),
            (-(x ** 2), "-x^2"),
            ((-x) ** 2, "(-x)^2"),
            (x ** y ** z, "x^(y^z)"),
            ((x ** y) ** z, "(x^y)^z"),
            (2 ** -x, "2^(-x)"),
            (x * -y, "x*(-y)"),
            (x - 0.1, "x - 0.1"),
            (x * -2, "x*(-2)"),
            (1e-300 * x, "1e-300*x"),
        ]:
            self.assertEqual(str(symbol), text)

    def test_a_traced_formula_has_the_value_of_the_function(self):
        functions = [
            lambda x, y: x - (y - x / (y * 3.7)) ** 2,
            lambda x, y: np.sqrt(np.hypot(x, y)) * np.exp(-x ** 2) / (1 + np.abs(y)),
            lambda x, y: np.arctan2(x, y) + np.minimum(x, y) * np.maximum(x, 2) - np.log1p(x * x),
            lambda x, y: -x ** 2 * -(y - 1) / -3,
            lambda x, y: x % 0.2 + np.mod(-3 * y, 2) + x // 0.1 + 2.5 % y + np.clip(x * y, 0.2, 0.22),
            lambda x, y: rb.sech(x) + rb.csch(y) + np.expm1(x / 3) + np.reciprocal(2 + y * y) + np.square(x),
        ]
        free = rb.Hamiltonian("x y", "u v", "u^2/2 + v^2/2")
        for function in functions:
            r = rb.integrate(free, [0.3, 0.7, 0.1, -0.2], (0, 0.2), step=0.1,
                             quantities={"f": lambda x, y, f=function: f(x, y)})
            expected = [function(x, y) for x, y in zip(r.x, r["y"])]
            np.testing.assert_allclose(r["f"], expected, rtol=1e-14, atol=0)
            # The comparison is one.
            self.assertFalse(np.allclose(r["f"], np.array(expected) + 1e-9, rtol=1e-14, atol=0))

    def test_choices_and_special_functions(self):
        x, y = rb.symbols("x y")
        self.assertEqual(str(np.where(x > 0, x ** 2, -y)), "where(x > 0, x^2, -y)")
        self.assertEqual(str(rb.where(np.float64(1) >= x + y, 0, 1)), "where(1 >= x + y, 0, 1)")
        np.testing.assert_array_equal(rb.where(np.array([True, False]), 1, 2), [1, 2])
        self.assertEqual(str(np.expm1(x) + np.log1p(y)), "expm1(x) + log1p(y)")
        with self.assertRaisesRegex(TypeError, "where a and b hold"):
            (x > 0) & (y > 0)
        with self.assertRaisesRegex(TypeError, "numpy.piecewise has no formula: write it with where"):
            np.piecewise(x, [x > 0], [1.0])
        for wrong in (lambda: (x > 0) + 1, lambda: (x > 0) % 2, lambda: (x > 0) > y, lambda: bool(x > 0), lambda: rb.where(x > 0, x < 1, 2),
                      lambda: np.sin(x > 0), lambda: rb.Hamiltonian("x", "y", lambda x, y: x > y) and rb.integrate(
                          rb.Hamiltonian("x", "y", lambda x, y: x > y), [0, 1], (0, 1), step=0.1)):
            with self.assertRaises((TypeError, rb.ProblemError)):
                wrong()
        wall = rb.Hamiltonian("q", "p", lambda q, p: p ** 2 / 2 + np.where(q > 1, 50 * (q - 1) ** 2, 0))
        r = rb.integrate(wall, [0, 1], (0, 1.5), step=0.01, events={"far": lambda q, p: q > 1.05})
        self.assertLess(r.q.max(), 1.2)
        self.assertEqual(len(r.events["far"]), 1)

    @unittest.skipUnless(importlib.util.find_spec("scipy"), "SciPy is not installed")
    def test_scipys_functions(self):
        from scipy import special

        x, y = rb.symbols("x y")
        self.assertEqual(str(special.erf(x) + special.jv(2, y)), "erf(x) + besselj(2, y)")
        with self.assertRaisesRegex(TypeError, "gamma"):
            special.gamma(x)

    def test_vectors_and_parameters(self):
        kepler = rb.Hamiltonian("r[2]", "v[2]", lambda r, v, m: v @ v / 2 - m / np.sqrt(r @ r), m=1)
        self.assertEqual(kepler.names, ["r1", "r2", "v1", "v2"])
        r = rb.integrate(kepler, [1, 0, 0, 1], (0, 1), step=0.1)
        self.assertLess(np.abs(np.hypot(r.r1, r.r2) - 1).max(), 1e-6)
        functions = [lambda r, v: r @ v, lambda r1, v1, r2, v2: r1 * v1 + r2 * v2, lambda t, y: y[:2] @ y[2:],
                     lambda a, b: a @ b]
        found = [rb.integrate(kepler, [0.4, 0, 0, 2], (0, 5), step=0.1, events=function, quantities={"L": lambda r, v: (
            r[0] * v[1] - r[1] * v[0])}) for function in functions]
        for one in found:
            self.assertEqual(len(one.t_events[0]), 1)
            np.testing.assert_allclose(one.t_events[0], found[0].t_events[0], rtol=1e-14)
            np.testing.assert_allclose(one.L, 0.8, rtol=1e-12)

    @unittest.skipUnless(importlib.util.find_spec("sympy"), "SymPy is not installed")
    def test_three_ways_are_one(self):
        import sympy

        q, p = sympy.symbols("q p")
        ways = [lambda q, p: p ** 2 / 2 - np.cos(q), "p^2/2 - cos(q)", p ** 2 / 2 - sympy.cos(q)]
        results = [rb.integrate(rb.Hamiltonian("q", "p", way), [0, 1.9], (0, 5), step=0.1) for way in ways]
        for r in results[:2]:
            np.testing.assert_array_equal(r.y, results[0].y)
        np.testing.assert_allclose(results[2].y, results[0].y, rtol=0, atol=1e-12)

    def test_long_sums_and_shared_parts(self):
        chain = rb.Hamiltonian("x[300]", "p[300]", lambda x, p: sum(p * p) / 2 + sum((x[1:] - x[:-1]) ** 2) / 2)
        self.assertEqual(len(chain.names), 600)

        def doubled(q, p):
            for _ in range(40):
                q = q * q + 1e-3 * q
            return p * p / 2 + q

        self.assertLess(len(rb.Hamiltonian("q", "p", doubled).text), 5000)
        r = rb.integrate(rb.Hamiltonian("q", "p", doubled), [0.1, 0.1], (0, 0.1), step=0.05, levels="fixed")
        self.assertTrue(r.success)

    def test_what_has_no_formula_is_refused(self):
        import math

        for function in [lambda x, y: math.sin(x), lambda x, y: x if x > 0 else y, lambda x, y: np.ceil(x),
                         lambda x, y: 1j * x, lambda x, y: "x", lambda x, y: None, lambda w: w,
                         lambda x, y: x == y, lambda x, y: (x > y) * 2,
                         lambda x, y: np.array([x, y]), lambda x, y: x + "1"]:
            with self.assertRaises(TypeError):
                self.formula(function)
        with self.assertRaises(ValueError):
            self.formula(lambda x, y, px, py: x * float("nan"))

    def test_other_tables(self):
        coarse = rb.Hamiltonian("q", "p", "p^2/2 - cos(q)", tables={"verdict": {"accept": ["resolution"]}})
        self.assertIn('accept = ["resolution"]', rb.integrate(coarse, [0, 1], (0, 1), step=0.1).problem)
        for wrong in (5, {"verdict": 5}):
            with self.assertRaisesRegex(TypeError, "tables"):
                rb.Hamiltonian("q", "p", "p^2/2", tables=wrong)
        with self.assertRaisesRegex(rb.ProblemError, "verdict"):
            rb.integrate(rb.Hamiltonian("q", "p", "p^2/2", tables={"verdit": {"accept": []}}), [0, 1], (0, 1), step=0.1)

    def test_equations_in_the_place_of_fields(self):
        pair = ["u_tt = u_xx - sin(u - v)", "v_tt = v_xx + sin(u - v)"]
        for equation in ("u_tt = u_xx - sin(u)", pair):
            first, second = rb.Field(equation), rb.Field(equation=equation)
            self.assertEqual(first._tables, second._tables)
        for wrong in ("u", ["u", "v"], ["u_tt = u_xx", "v"], [], None):
            with self.assertRaisesRegex(TypeError, "one of L, H and equation"):
                rb.Field(wrong)

    def test_misspelt_words(self):
        with self.assertRaisesRegex(TypeError, "title"):
            rb.Hamiltonian("q", "p", "p^2/2", tittle="x")
        with self.assertRaisesRegex(TypeError, "stages"):
            rb.integrate(rb.Hamiltonian("q", "p", "p^2/2 + q^2"), [0, 1], (0, 1), step=0.1, stagse=2)
        with self.assertRaisesRegex(AttributeError, "integrate"):
            rb.integrat
        with self.assertRaisesRegex(TypeError, "t_span"):
            rb.integrate(rb.Hamiltonian("q", "p", "p^2/2"), [0, 1], until=1, step=0.1)
        wave = rb.Field(equation="u_tt = u_xx")
        for word, call in (("terminal", lambda: rb.Event("q", termnal=True)), ("replay", lambda: rb.check("a.h5", repaly=True)),
                           ("until", lambda: rb.resume("a.h5", untill=2)), ("crossing", lambda: rb.Event(crosing="q")),
                           ("initial", lambda: rb.Lattice(wave, {"x": (0, 1, 9)}, intial={"u": 0})),
                           ("axes", lambda: rb.run("pendulum", until=1).plot(axs=None)),
                           ("step", lambda: rb.integrate(rb.Hamiltonian("q", "p", "p^2/2"), [0, 1], (0, 1), stp=0.1))):
            with self.assertRaisesRegex(TypeError, f"did you mean {word}"):
                call()
        r = rb.integrate(rb.Hamiltonian("q", "p", "p^2/2 + q^2"), [0, 1], (0, 1), step=0.1)
        with self.assertRaisesRegex(AttributeError, "energy"):
            r.enregy
        with self.assertRaisesRegex(KeyError, "gamma"):
            r["gama"]
        with self.assertRaisesRegex(rb.ProblemError, "did you mean"):
            rb.Hamiltonian("q", "p", "p^2/2 + coz(q)") and rb.integrate(
                rb.Hamiltonian("q", "p", "p^2/2 + coz(q)"), [0, 1], (0, 1), step=0.1)


class Constraints(unittest.TestCase):
    def test_functions_and_texts_are_the_same_constraints(self):
        def rod(length):
            return rb.Hamiltonian("x y", "a b", "(a^2 + b^2)/2 + y", constraints={"length": length})

        self.assertEqual(rod(lambda x, y: x**2 + y**2 - 1).text, rod("x^2 + y^2 - 1").text)
        self.assertIn('[constraints]\nlength = "x^2 + y^2 - 1"', rod("x^2 + y^2 - 1").text)

    def test_an_orbit_keeps_them(self):
        rod = rb.Hamiltonian("x y", "a b", "(a^2 + b^2)/2 + y", constraints={"length": lambda x, y: x**2 + y**2 - 1})
        result = rb.integrate(rod, [0.6, -0.8, 0.8, 0.6], (0, 10), step=0.1, scheme="splitting")
        self.assertTrue(result.success)
        self.assertLess(np.abs(result.y[0] ** 2 + result.y[1] ** 2 - 1).max(), 1e-14)
        by_default = rb.integrate(rod, [0.6, -0.8, 0.8, 0.6], (0, 1), step=0.1)
        self.assertLess(np.abs(by_default.y[0] ** 2 + by_default.y[1] ** 2 - 1).max(), 1e-14)
        free = rb.Hamiltonian("x y", "a b", "(a^2 + b^2)/2 + y")
        falling = rb.integrate(free, [0.6, -0.8, 0.8, 0.6], (0, 10), step=0.1, scheme="splitting")
        self.assertGreater(np.abs(falling.y[0] ** 2 + falling.y[1] ** 2 - 1).max(), 1)
        motion = rb.Lagrangian("x y", "(x_dot^2 + y_dot^2)/2 - y", constraints={"length": "x^2 + y^2 - 1"})
        self.assertTrue(rb.integrate(motion, [0.6, -0.8, 0.8, 0.6], (0, 1), step=0.1).success)
        with self.assertRaisesRegex(ValueError, "start from x = "):
            rb.integrate(rod, [0.7, -0.8, 0.8, 0.6], (0, 1), step=0.1, scheme="splitting")

    def test_tangents_and_boundary_values(self):
        rod = rb.Hamiltonian("x y", "a b", "(a^2 + b^2)/2 + y", constraints={"length": "x^2 + y^2 - 1"})
        r = rb.integrate(rod, [0.6, -0.8, 0.8, 0.6], (0, 20), step=0.1, scheme="splitting",
                         tangents={"vectors": "all", "matrix": True})
        self.assertEqual(len(r.lyapunov.exponents), 2)
        self.assertLess(r.lyapunov.two_form.max(), 1e-14)
        moved = r.tangent[-1] @ [0.8, 0.6, -0.6, 0.8]
        self.assertLess(abs(r.y[:2, -1] @ moved[:2]), 1e-13 * np.abs(moved).max())
        found = rb.solve(rod, {"ends": {"a_0": 0, "x_1": 0.3}, "time": 2.2}, initial=[-0.96, -0.28, 0, 0],
                         t_span=(0, 2.2), step=0.1, scheme="splitting")
        self.assertTrue(found.success)
        self.assertLess(abs(found.y[0, -1] - 0.3), 1e-12)
        self.assertLess(np.abs(found.y[0] ** 2 + found.y[1] ** 2 - 1).max(), 1e-12)


class Fields(unittest.TestCase):
    def test_four_statements_of_one_equation(self):
        grid, initial = {"x": (-10, 10, 101)}, {"u": lambda x: 0.5 * rb.sech(x)}
        statements = [
            rb.Field("u", lambda u, u_t, u_x: u_t ** 2 / 2 - u_x ** 2 / 2 - (1 - np.cos(u))),
            rb.Field("u", "u_t^2/2 - u_x^2/2 - (1 - cos(u))"),
            rb.Field(equation="u_tt = u_xx - sin(u)"),
        ]
        results = [rb.integrate(rb.Lattice(system, grid, dict(initial, u_t=0)), (0, 1), step=0.1)
                   for system in statements]
        named = rb.Multisymplectic("u v w", [["u", "v", -1]], [["u", "w", 1]],
                                   lambda u, v, w: (v ** 2 - w ** 2) / 2 + 1 - np.cos(u))
        results.append(rb.integrate(rb.Lattice(named, grid, dict(initial, v=0)), (0, 1), step=0.1))
        for r in results:
            self.assertEqual(r.u.shape, (len(r.t), 101))
            np.testing.assert_allclose(r.u, results[0].u, atol=1e-9)
        self.assertGreater(np.abs(results[0].u[-1] - results[0].u[0]).max(), 1e-3)

    def test_the_box_between_walls_keeps_its_energy(self):
        wave = rb.Field(equation="u_tt = u_xx - sin(u)")
        for left, right, shape, cells in (("fixed", "fixed", "sin(pi*x)", 40), ("free", "free", "cos(pi*x)", 41),
                                          ("fixed", "free", "sin(pi*x/2)", 41)):
            line = {"x": {"from": 0, "to": 1, "cells": cells, "left": left, "right": right}}
            lattice = rb.Lattice(wave, line, {"u": f"0.5*{shape}", "u_t": 0})

            def spread(levels):
                r = rb.integrate(lattice, (0, 2), step=0.02, scheme="box", levels=levels)
                self.assertEqual(r.u.shape[1], cells + 1)  # the nodes of both walls
                self.assertEqual(r.verdict, "good")
                return np.ptp(r.energy) / abs(r.energy[0])

            self.assertLess(spread("variable"), 1e-13)
            self.assertGreater(spread("fixed"), 1e-9)  # the twin: levels that do not give way

    def test_initial_data_as_arrays_functions_and_texts(self):
        wave = rb.Field(equation="u_tt = u_xx - sin(u)")
        grid = {"x": (-10, 10, 101)}
        x = -10 + np.arange(101) * (20 / 101)
        traced = rb.Lattice(wave, grid, {"u": lambda x: np.exp(-x ** 2), "u_t": "0"})
        text = rb.Lattice(wave, grid, {"u": "exp(-x^2)", "u_t": 0})
        array = rb.Lattice(wave, grid, {"u": np.exp(-x ** 2), "u_t": np.zeros(101)})
        called = rb.Lattice(wave, grid, {"u": lambda x: np.interp(x, x, np.exp(-x ** 2)), "u_t": 0})
        results = [rb.integrate(lattice, (0, 1), step=0.1) for lattice in (traced, text, array, called)]
        np.testing.assert_array_equal(results[0].u, results[1].u)
        np.testing.assert_array_equal(results[2].u, results[3].u)
        np.testing.assert_allclose(results[2].u, results[0].u, atol=1e-10)
        turns = rb.Lattice(rb.Field(equation="u_tt = c^2*u_xx", c=2), {"x": ("-c*pi", "2*pi", 9)}, {"u": 0, "u_t": 1})
        np.testing.assert_allclose(turns.coordinates[0], -2 * np.pi + np.arange(9) * (4 * np.pi / 9), rtol=1e-14)
        schroedinger = rb.Field(equation="i*psi_t + psi_xx/2 = 0")
        parts = {"p": np.exp(-x ** 2) * np.cos(x), "q": np.exp(-x ** 2) * np.sin(x)}
        results = [rb.integrate(rb.Lattice(schroedinger, grid, start), (0, 0.5), step=0.1)
                   for start in (parts, {"psi": parts["p"] + 1j * parts["q"]},
                                 {"psi": lambda x: np.exp(-x ** 2) * np.cos(x) + 1j * np.exp(-x ** 2) * np.sin(x)})]
        for r in results:
            np.testing.assert_array_equal(r.q, results[0].q)
        self.assertGreater(np.abs(results[0].q[-1]).max(), 0.1)
        np.testing.assert_array_equal(results[1].psi, results[0].p + 1j * results[0].q)
        second = rb.Field(equation="psi_tt = psi_xx - psi", psi=["p", "q"])
        ring = {"x": (0, 2 * np.pi, 33)}
        rate = np.sqrt(2.0)
        for start in ({"psi": "exp(i*x)", "psi_t": "-i*sqrt(2)*exp(i*x)"},
                      {"psi": lambda x: np.exp(1j * x), "psi_t": lambda x: -1j * rate * np.exp(1j * x)}):
            wave_of_psi = rb.integrate(rb.Lattice(second, ring, start), (0, 1), step=0.01, scheme="fourier")
            exact = np.exp(1j * (wave_of_psi.x - rate * wave_of_psi.t[:, None]))
            # The phase of the midpoint rule is off by w (w h)^2/12 t = 2.4e-5.
            np.testing.assert_allclose(wave_of_psi.psi, exact, atol=5e-5)
            np.testing.assert_allclose(wave_of_psi.psi_t, -1j * rate * exact, atol=1e-4)
        self.assertGreater(np.abs(wave_of_psi.psi[-1] - wave_of_psi.psi[0]).max(), 0.1)
        damped = rb.Field(equation="u_tt + 0.5*u_t = u_xx")
        decays = rb.integrate(rb.Lattice(damped, ring, {"u": "cos(x)", "u_t": 0}), (0, 2), step=0.01, scheme="fourier",
                              every=20)
        w = np.sqrt(1 - 0.25 ** 2)
        t = decays.t[:, None]
        exact = np.exp(-0.25 * t) * (np.cos(w * t) + 0.25 / w * np.sin(w * t)) * np.cos(decays.x)
        np.testing.assert_allclose(decays.u, exact, atol=1e-4)
        np.testing.assert_allclose(decays.u_t, -np.exp(-0.25 * t) * np.sin(w * t) / w * np.cos(decays.x), atol=1e-4)
        self.assertGreater(np.abs(decays.scaled_u - exact).max(), 0.1)  # the twin: another field
        self.assertIn("u", decays)
        self.assertNotIn("psi", decays)
        for wrong in ({"psi": np.zeros(7, dtype=complex)}, {"psi": "abc"}, {"psi": None}):
            with self.assertRaises((TypeError, ValueError)):
                rb.integrate(rb.Lattice(schroedinger, grid, wrong), (0, 0.5), step=0.1)
        with self.assertRaisesRegex(ValueError, "shape"):
            rb.integrate(rb.Lattice(wave, grid, {"u": np.zeros(100), "u_t": 0}), (0, 1), step=0.1)
        hidden = np.ma.masked_array(np.zeros(101), mask=np.arange(101) == 3)
        with self.assertRaisesRegex(TypeError, "masked"):
            rb.Lattice(wave, grid, {"u": hidden, "u_t": 0})
        rb.Lattice(wave, grid, {"u": hidden.filled(0.0), "u_t": 0})
        with self.assertRaisesRegex(TypeError, "masked"):
            rb.Lattice(wave, grid, {"u": lambda x: np.ma.masked_less(x, 0) if isinstance(x, np.ndarray) else float(x),
                                    "u_t": 0})
        with self.assertRaisesRegex(TypeError, "masked"):
            rb.Lattice(schroedinger, grid, {"psi": hidden + 0j})
        pendulum = rb.Hamiltonian("q", "p", "p^2/2 - cos(q)")
        state = np.ma.masked_array([0.0, 1.9], mask=[False, True])
        for initial in (state, np.ma.masked_array([state, state])):
            with self.assertRaisesRegex(TypeError, "initial is a masked array"):
                rb.integrate(pendulum, initial, (0, 1), step=0.1)
        rb.integrate(pendulum, state.filled(1.9), (0, 1), step=0.1)
        for times, problem in ((np.ma.masked_array([0.5, 1.0], mask=[True, False]), TypeError), ([], ValueError),
                               ([[0.5]], ValueError)):
            with self.assertRaisesRegex(problem, "t_eval"):
                rb.integrate(pendulum, [0, 1.9], (0, 1), step=0.1, t_eval=times)
        with self.assertRaisesRegex(ValueError, "nan at node 3"):
            bad = np.zeros(101)
            bad[3] = np.nan
            rb.integrate(rb.Lattice(wave, grid, {"u": bad, "u_t": 0}), (0, 1), step=0.1)


if __name__ == "__main__":
    unittest.main()
