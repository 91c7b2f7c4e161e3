"""The package as others get it: stubs, a wheel, its import, its memory."""

import ast
import ctypes
import gc
import importlib.util
import inspect
import os
import subprocess
import sys
import tempfile
import unittest
import zipfile
from pathlib import Path

import numpy as np

import rubato as rb

SOURCES = Path(os.environ.get("RUBATO_SOURCES", Path(__file__).parents[2]))
BUILD = Path(rb.__file__).parents[2]

TYPED = """
import numpy as np
import rubato as rb

pendulum = rb.Hamiltonian("q", "p", lambda q, p: p**2/2 - np.cos(q))
r: rb.Result = rb.integrate(pendulum, [0, 1.9], (0, 20), step=0.1)
top: float = r.energy.max() - r.energy.min()
for step in rb.Integrator(pendulum, [0, 1.9], (0, 1), step=0.1):
    t: float = step.t
table: str = rb.check("a.h5").table
"""
MISTYPED = {
    'rb.integrate(pendulum, [0, 1.9], (0, 20), step=0.1, threads="two")': "threads",
    "rb.Hamiltonian(1, 2, 3)": "Hamiltonian",
    "rb.integrat(pendulum)": "integrat",
    "x: str = rb.run('kepler').energy": "Incompatible",
}


class Malloc(ctypes.Structure):
    """mallinfo2() of glibc."""

    _fields_ = [(name, ctypes.c_size_t) for name in ("arena", "ordblks", "smblks", "hblks", "hblkhd", "usmblks",
                                                     "fsmblks", "uordblks", "fordblks", "keepcost")]


def held():
    """The bytes of malloc and the blocks of Python in use."""
    ask = ctypes.CDLL(None).mallinfo2
    ask.restype = Malloc
    gc.collect()
    now = ask()
    return now.uordblks + now.hblkhd, sys.getallocatedblocks()


def growth(work, cycles):
    """By how many bytes of malloc, and blocks of Python, so many cycles grow, after as many to warm up."""
    for _ in range(cycles):
        work()
    before = held()
    for _ in range(cycles):
        work()
    return [after - early for after, early in zip(held(), before)]


class Package(unittest.TestCase):
    @unittest.skipUnless(importlib.util.find_spec("mypy"), "mypy is not installed")
    def test_stubs(self):
        def check(text):
            with tempfile.TemporaryDirectory() as folder:
                file = Path(folder) / "user.py"
                file.write_text(text, encoding="utf-8")
                return subprocess.run([sys.executable, "-m", "mypy", "--strict", "--cache-dir", "/dev/null", str(file)],
                                      capture_output=True, text=True, cwd=folder, check=False)

        self.assertEqual(check(TYPED).returncode, 0, check(TYPED).stdout)
        wrong = check(TYPED + "\n".join(MISTYPED))
        for line in MISTYPED.values():
            self.assertIn(line, wrong.stdout)

    def test_stubs_have_the_signatures_of_the_package(self):
        tree = ast.parse((Path(rb.__file__).parent / "__init__.pyi").read_text(encoding="utf-8"))
        stated = {node.name: node for node in tree.body if isinstance(node, (ast.FunctionDef, ast.ClassDef))}
        self.assertLessEqual(set(rb.__all__), set(stated))
        compared = 0

        def compare(node, function, where):
            nonlocal compared
            listed = [argument.arg for argument in node.args.posonlyargs + node.args.args + node.args.kwonlyargs]
            real = [p.name for p in inspect.signature(function).parameters.values()
                    if p.kind not in (p.VAR_KEYWORD, p.VAR_POSITIONAL)]
            self.assertEqual(listed, real, where)
            compared += 1

        for name, node in stated.items():
            if isinstance(node, ast.FunctionDef):
                compare(node, getattr(rb, name), name)
            elif not name.startswith("_"):
                for part in node.body:
                    if isinstance(part, ast.FunctionDef) and not part.decorator_list:
                        function = inspect.getattr_static(getattr(rb, name), part.name, None)
                        if inspect.isfunction(function) and not part.name.startswith("__r"):
                            compare(part, function, f"{name}.{part.name}")
        self.assertGreater(compared, 30)

    @unittest.skipUnless(importlib.util.find_spec("pip"), "pip is not installed")
    def test_a_wheel(self):
        with tempfile.TemporaryDirectory() as folder:
            command = [sys.executable, "-m", "pip", "wheel", "--no-deps", "--no-index", "--quiet",
                       "--config-settings", f"folder={BUILD}", "-w", folder, str(SOURCES)]
            environment = {key: value for key, value in os.environ.items() if key != "PYTHONPATH"}
            subprocess.run(command, check=True, env=environment)
            wheel, = Path(folder).glob("rubato-*.whl")
            first = wheel.read_bytes()
            subprocess.run(command, check=True, env=environment)
            self.assertEqual(wheel.read_bytes(), first)
            self.assertIn(f"cp{sys.version_info.major}{sys.version_info.minor}", wheel.name)
            with zipfile.ZipFile(wheel) as packed:
                names = packed.namelist()
                self.assertEqual({name.partition("/")[0] for name in names},
                                 {"rubato", f"rubato-{rb.__version__}.dist-info"})
                self.assertIn("rubato/__init__.pyi", names)
                packed.extractall(Path(folder) / "installed")
            subprocess.run([sys.executable, "-c", "import rubato as rb; assert rb.run('pendulum', until=1).success"],
                           check=True, env=dict(environment, PYTHONPATH=str(Path(folder) / "installed")), cwd=folder)

    @unittest.skipUnless(hasattr(ctypes.CDLL(None), "mallinfo2"), "this C library does not count its memory")
    def test_memory_does_not_grow(self):
        pendulum = rb.Hamiltonian("q", "p", lambda q, p: p ** 2 / 2 - np.cos(q))
        kept = []

        def cycle():
            r = rb.integrate(pendulum, [0, 1], (0, 0.3), step=0.1)
            return next(rb.Integrator(pendulum, [0, 1], (0, 0.3), step=0.1)).y, r.y

        def leaking():
            kept.append(np.ones(128))
            cycle()

        # A kilobyte and an object of Python that each cycle leaves behind are seen.
        cycles = 200
        size, blocks = growth(cycle, cycles)
        self.assertLess(size, cycles * 512)
        self.assertLess(blocks, cycles)
        size, blocks = growth(leaking, cycles)
        self.assertGreater(size, cycles * 512)
        self.assertGreaterEqual(blocks, cycles)

    @unittest.skipUnless(hasattr(ctypes.CDLL(None), "mallinfo2"), "this C library does not count its memory")
    def test_arrays_of_a_lattice_are_not_copied(self):
        from rubato import _problem

        cells = 1_000_000
        u = np.zeros(cells)
        wave = rb.Field(equation="u_tt = u_xx - sin(u)")

        def taken(*arrays):
            """How many arrays of such a size a problem takes beside the ones it is given."""
            before, _ = held()
            lattice = rb.Lattice(wave, {"x": (0, 1000, cells)}, {"u": arrays[0], "u_t": arrays[-1]})
            kept = _problem.build(lattice, (0, 1e-3), None, step=1e-3, levels="fixed", scheme="leapfrog")
            size = held()[0] - before
            return size / u.nbytes if kept else None

        self.assertLess(taken(u), 0.1)
        self.assertGreater(taken(u, u.astype("f4")), 0.9)  # other numbers have to be converted
        lattice = rb.Lattice(wave, {"x": (0, 1000, cells)}, {"u": u, "u_t": u})
        r = rb.integrate(lattice, (0, 1e-3), step=1e-3, levels="fixed", scheme="leapfrog", settings=["laws.every=false"])
        before, _ = held()
        column = r.u
        self.assertEqual(column.shape, (2, cells))
        self.assertLess(held()[0] - before, u.nbytes / 10)
        copy = column.copy()
        self.assertGreater(held()[0] - before, copy.nbytes * 0.9)

    def test_import_loads_nothing_else(self):
        """Beside NumPy an import loads Rubato's own modules alone, and starts no thread."""
        code = ("import os, sys, numpy; threads = len(os.listdir('/proc/self/task')); before = set(sys.modules); {}; "
                "print(*sorted({{m.partition('.')[0] for m in set(sys.modules) - before}}), "
                "*['thread'] * (len(os.listdir('/proc/self/task')) - threads))")

        def loaded(statement):
            return subprocess.run([sys.executable, "-c", code.format(statement)], capture_output=True, text=True,
                                  check=True).stdout.split()

        self.assertEqual(loaded("import rubato"), ["rubato"])
        self.assertEqual(loaded("import rubato, colorsys"), ["colorsys", "rubato"])
        waiting = "import rubato, _thread; _thread.start_new_thread(__import__('time').sleep, (60,))"
        self.assertIn("thread", loaded(waiting))


if __name__ == "__main__":
    unittest.main()
