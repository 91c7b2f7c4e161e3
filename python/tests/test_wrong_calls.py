"""A thousand wrong calls: each is an exception with words, none ends the process."""

import random
import unittest
import warnings

import numpy as np

import rubato as rb

PENDULUM = rb.Hamiltonian("q", "p", "p^2/2 - cos(q)")
WAVE = rb.Field(equation="u_tt = u_xx - sin(u)")
LINE = {"x": (-10, 10, 51)}


class Odd:
    """Of no use anywhere."""

    def __array__(self, *_):
        raise RuntimeError("no array")


def read_only(array):
    array.flags.writeable = False
    return array


# What no numbers may be, where two of them are wanted.
WRONG_STATES = [None, "abc", 3.5, [], [1], [1, 2, 3], [[[1, 2]]], [np.nan, 1], [np.inf, 1], [1j, 2], ["a", "b"],
                [None, 1],
                np.zeros((0, 2)), np.zeros(3), np.array([1, 2], dtype="datetime64[s]"), np.array(["1", "2"]),
                np.array([1, 2], dtype=object), {"q": 1}, {"q": 0, "p": 1, "r": 2}, {"q": "0 +", "p": 1},
                {"q": [1, 2], "p": 1}, {1: 2}, {"q": None, "p": 1}, {"q": np.nan, "p": 1}, Odd(), object(), b"12",
                [True, "x"], np.ones((2, 2, 2)), np.ones((3, 3)), np.full((2, 2), np.nan), {"q": Odd(), "p": 0}, {1, 2},
                np.zeros(2, dtype=[("a", float)]), np.ma, repr, read_only(np.full(2, np.inf)), np.full(6, 1.0)[::2]]
WRONG_NUMBERS = [None, "", "abc", [], [1], np.nan, np.inf, -np.inf, 1j, Odd(), object(), {}, b"1", repr, "1e", "0.1 +"]
WRONG_COUNTS = [-1, 0, 1.5, "x", [], 10**30, np.nan, {}, Odd(), -10**30, "3 4"]
WRONG_TEXTS = ["", "(", "q +", "1/", "sin", "sin(", "q^", "unknown", "cos(q, p)", "q = p", "\0", "q\n+", "ä", "𝕃 + q",
               0j, [], {},
               None, object(), b"q", "q" * 100 + "!", "((((", "'", "\"", "foo(q)", "1..2", "q q", "min()", "pi()"]
WRONG_WORDS = ["", "gaus", 1, [], {}, 0.5, "GAUSS", "midpoint ", "\n", object(), b"gauss"]
WRONG_SPANS = [None, 1, "ab", (0,), (0, 1, 2), (0, "b"), ("0", "1"), (0, np.nan), (np.inf, 1), (0, np.inf), [], {},
               Odd(), (None, 1), (0, 0),
               (0, -1), ((0, 1), 2), (1j, 2)]
WRONG_TIMES = ["abc", [], 1.0, [[1.0]], [np.nan], [2, 1], [1, 1], [-1], [100.0], [1j], ["a"], {}, Odd(),
               np.zeros((2, 2)), [None]]
WRONG_EVENTS = [5, ["q +"], {"a": "q +"}, {"a": None}, [lambda t, y: y[5]], [lambda z: z], {"a": {}}, object(), [repr],
                [lambda t, y: "x"], [lambda t, y: 0 < y[0] < 1], {"a": rb.Event("unknown")}, [1j], [[]]]


def calls(random):
    """Yields (what, function): calls with one wrong argument each."""
    def integrate(**wrong):
        arguments = dict(initial=[0.1, 1.0], t_span=(0, 0.3), step=0.1)
        arguments.update(wrong)
        of_integrate = {"t_eval", "every", "file", "progress", "quantities"}
        function = rb.integrate if set(wrong) & of_integrate else random.choice([rb.integrate, rb.Integrator])
        return lambda: function(PENDULUM, **arguments)

    def hamiltonian(*arguments, **keywords):
        return lambda: rb.integrate(rb.Hamiltonian(*arguments, **keywords), [0.1, 1.0], (0, 0.3), step=0.1)

    def lattice(**wrong):
        arguments = dict(grid=LINE, initial={"u": "exp(-x^2)", "u_t": 0}, system=WAVE)
        arguments.update(wrong)
        return lambda: rb.integrate(rb.Lattice(**arguments), (0, 0.2), step=0.1)

    wrong_fields = ([np.zeros(n) for n in (0, 1, 50, 52)] + [np.zeros((51, 1)), np.zeros((1, 51)), np.full(51, np.nan),
                    np.full(51, np.inf), np.zeros(51, dtype=complex), np.array(["a"] * 51), np.zeros(51, dtype=object),
                    [1, 2],
                    "x +", "unknown", None, {}, object(), lambda x, y: x, lambda x: "x",
                    lambda x: np.zeros(7), np.zeros(102)[::2][:50], "sqrt(-1)", "1/(x + 10)", "y"])
    wrong_grids = [None, {}, {"x": 1}, {"x": (0, 1)}, {"x": (0, 1, 2)}, {"x": (1, 0, 51)}, {"x": (0, 1, -3)},
                   {"x": (0, 1, 5.5)},
                   {"w": (0, 1, 51)}, {"x": (0, np.nan, 51)}, {"x": ("a", 1, 51)}, {"y": (0, 1, 51)},
                   [], "x", {"x": {}}, {1: 2},
                   {"x": (0, 1, 10**12)}, {"x": {"from": 0, "to": 1, "cells": 51, "cell": 1}}, {"x": (0, 0, 51)},
                   {"x": {"from": 0}}]
    choices = [
        ("initial", lambda: integrate(initial=random.choice(WRONG_STATES))),
        ("members", lambda: (lambda states, how: lambda: rb.integrate(PENDULUM, states, (0, 0.3), step=0.1, **how))(
            *random.choice([(np.zeros((0, 2)), {}), (np.ones((2, 3)), {}), (np.full((2, 2), np.nan), {}),
                            (np.ones((2, 2)) * 1j, {}), (np.ones((2, 2), dtype=object), {}), ([["a", "b"]], {}),
                            (np.ones((2, 2)), {"t_eval": [5.0]}), (np.ones((2, 2)), {"every": 0}),
                            (np.ones((2, 2)), {"file": "a.h5"}), (np.ones((2, 2)), {"quantities": {"a": "q"}}),
                            (np.ones((2, 2)), {"events": "q +"}), (np.ones((2, 2)), {"threads": -1}),
                                                        (np.ones((2, 2)), {"events": rb.Event("q", reset=lambda t, y: y)})]))),
        ("a step's event", lambda: (lambda reset: lambda: list(rb.Integrator(
            PENDULUM, [0.1, 1], (0, 5), step=0.1, events=rb.Event("p", reset=reset))))(
            random.choice([lambda t, y: [1], lambda t, y: "ab", lambda t, y: y[5], lambda: None, lambda t, y: y * np.nan,
                           lambda t, y: {"q": 1}, lambda t, y: [[1, 2]]]))),
        ("assignment", lambda: (lambda name, value: lambda: setattr(
            rb.Integrator(PENDULUM, [0.1, 1], (0, 5), step=0.1), name, value))(
            *random.choice([("y", [1]), ("y", None), ("y", "ab"), ("y", [np.nan, 1]), ("Y", [1, 2]), ("q", "a"), ("q", np.nan),
                            ("q", [1, 2]), ("t", 1.0), ("h", 0.1), ("energy", 1)]))),
        ("t_span", lambda: integrate(t_span=random.choice(WRONG_SPANS))),
        ("step", lambda: integrate(step=random.choice(WRONG_NUMBERS + [0, -0.1, "auto"]))),
        ("scheme", lambda: integrate(scheme=random.choice(WRONG_WORDS[1:] + ["box", "splittin", "custom"]))),
        ("stages", lambda: integrate(stages=random.choice(WRONG_COUNTS + [9]))),
        ("levels", lambda: integrate(levels=random.choice(WRONG_WORDS))),
        ("t_eval", lambda: integrate(t_eval=random.choice(WRONG_TIMES))),
        ("events", lambda: integrate(events=random.choice(WRONG_EVENTS))),
        ("every", lambda: integrate(every=random.choice(WRONG_COUNTS))),
        ("quantities", lambda: integrate(quantities=random.choice([{"a": text} for text in WRONG_TEXTS] + ["a", 5]))),
        ("threads", lambda: integrate(threads=random.choice(WRONG_COUNTS[:1] + WRONG_COUNTS[2:] + [1025, None]))),
        ("settings",
         lambda: integrate(settings=random.choice([["scheme.stpe=1"], ["x"], "step=1", [5], 7, ["=1"], [""]]))),
        ("option",
         lambda: integrate(**{random.choice(["tolerence", "potential", "stage", "x", "H", "q", "dt", "rtol"]): 1})),
        ("tolerance", lambda: integrate(tolerance=random.choice(WRONG_NUMBERS[1:] + [-1, 2, 0]))),
        ("order", lambda: integrate(scheme="splitting", order=random.choice(WRONG_COUNTS + [3]))),
        ("composition", lambda: integrate(scheme="splitting", composition=random.choice(WRONG_WORDS))),
        ("progress", lambda: integrate(progress=lambda: None, t_span=(0, 1e7))),
        ("H", lambda: hamiltonian("q", "p", random.choice(WRONG_TEXTS))),
        ("names", lambda: hamiltonian(random.choice([None, "", [], "q p", "2q", "q[", "q[0]", "q[x]", "sin", "pi", "t",
                                                     5, ["q", 1], "q q",
                                                     "q[-1]", "p", "é"]), "p", "p^2/2")),
        ("parameter",
         lambda: hamiltonian("q", "p", "p^2/2 + k*q", k=random.choice(WRONG_TEXTS[1:] + [np.nan, np.inf]))),
        ("traced",
         lambda: hamiltonian("q", "p",
                             random.choice([lambda z: z, lambda q, p, r: q, lambda q, p: p / 0 if False else q.real,
                                       lambda q, p: q[0], lambda q, p: [q, p], lambda q, p: np.linalg.norm([q, p]) > 1,
                                       lambda q, p: int(q), lambda q, p: q and p, lambda q, p: np.fft.fft(q),
                                       lambda q, p: {}]))),
        ("system", lambda: (lambda system: lambda: rb.integrate(system, [0, 1], (0, 1), step=0.1))(
            random.choice([None, "pendulum", WAVE, 5, repr, rb.Hamiltonian, {}]))),
        ("field", lambda: lattice(initial={"u": random.choice(wrong_fields), "u_t": 0})),
        ("fields", lambda: lattice(initial=random.choice([None, {}, [], {"v": 0}, {"u": 0, "w": 1}, "u", {5: 0}]))),
        ("grid", lambda: lattice(grid=random.choice(wrong_grids))),
        ("lattice of", lambda: lattice(system=random.choice([None, PENDULUM, "u", 5]))),
        ("equation",
         lambda: (lambda text: lambda: rb.integrate(rb.Lattice(rb.Field(equation=text), LINE, {"u": 0}), (0, 0.2),
                                                    step=0.1))(
            random.choice(WRONG_TEXTS + ["u_t = u_xx", "u_tt = ", "u = u", ["u_t = v"]]))),
        ("run", lambda: (lambda name: lambda: rb.run(name, until=0.1))(
            random.choice(["", "pendulumm", None, 5, "/nowhere/x.toml", "/", [], b"\xff", "a\0b"]))),
        ("override", lambda: (lambda keys: lambda: rb.run("pendulum", **keys))(
            random.choice([{"untill": 1}, {"until": "x"}, {"parameters__x": 1}, {"scheme__stp": 1}, {"until": np.nan},
                           {"step": []}]))),
        ("open", lambda: (lambda file: lambda: random.choice([rb.open, rb.check, rb.resume])(file))(
            random.choice(["", "/nowhere.h5", __file__, "/", None, 5, "a\0b"]))),
        ("scan", lambda: (lambda values: lambda: rb.scan("pendulum", values, until=0.1))(
            random.choice([None, {}, [], {"initial.q": []}, {"x.y": [1]}, {"initial.p": [np.nan]},
                           {"initial.p": "0:1"}, {"initial.p": 5}]))),
        ("converge", lambda: (lambda tolerance: lambda: rb.converge("pendulum", tolerance, until=0.3))(
            random.choice(["x", [], -1, 0, np.nan, {}, b"1"]))),
        ("compare", lambda: (lambda a: lambda: rb.compare(a, a))(random.choice([None, "", "/nowhere", 5, PENDULUM]))),
        ("show", lambda: (lambda name: lambda: rb.show(name))(random.choice(["", "keplr", None, 5]))),
        ("event",
         lambda: (lambda keys: lambda: rb.Event("q", **keys) and rb.integrate(PENDULUM, [0, 1], (0, 5), step=0.1,
                                                                                      events=[rb.Event("q", **keys)]))(
            random.choice([{"direction": 2}, {"direction": "up"}, {"reset": 5}, {"reset": lambda t, y: [1]},
                           {"at": {"x": 1}},
                           {"terminal": -1}, {"terminal": "x"}, {"quantities": ["("]},
                           {"reset": lambda t, y: y * np.nan}]))),
    ]
    while True:
        what, make = random.choice(choices)
        yield what, make()


class WrongCalls(unittest.TestCase):
    def test_a_thousand(self):
        warnings.simplefilter("ignore")
        made = random.Random(48)
        accepted, silent = [], []
        for _, (what, call) in zip(range(1000), calls(made)):
            try:
                result = call()
            except Exception as error:  # whatever it is, it is one
                if not str(error):
                    silent.append((what, type(error)))
                if isinstance(error, (SystemError, AssertionError)):
                    self.fail(f"{what}: {error!r}")
            else:
                accepted.append((what, call, result))
        self.assertEqual(accepted, [])
        self.assertEqual(silent, [])
        self.assertTrue(rb.integrate(PENDULUM, [0, 1], (0, 1), step=0.1).success)

    def test_arrays_of_other_layouts_are_taken(self):
        state = np.array([0.1, 1.0])
        wanted = rb.integrate(PENDULUM, state, (0, 1), step=0.1).y
        many = np.zeros((2, 3))
        many[:, 1] = state
        for same in (read_only(state.copy()), many[:, 1], np.array([1.0, 0.1])[::-1], state.tolist(), tuple(state),
                     state.astype(">f8")):
            np.testing.assert_array_equal(rb.integrate(PENDULUM, same, (0, 1), step=0.1).y, wanted)
        x = -10 + np.arange(51) * (20 / 51)
        u = np.exp(-x ** 2)
        wanted = rb.integrate(rb.Lattice(WAVE, LINE, {"u": u, "u_t": u * 0}), (0, 0.2), step=0.1).u
        wide = np.zeros((51, 2))
        wide[:, 0] = u
        for same in (read_only(u.copy()), wide[:, 0], u[::-1].copy()[::-1], u.tolist()):
            np.testing.assert_array_equal(
                rb.integrate(rb.Lattice(WAVE, LINE, {"u": same, "u_t": 0 * u}), (0, 0.2), step=0.1).u, wanted)


if __name__ == "__main__":
    unittest.main()
