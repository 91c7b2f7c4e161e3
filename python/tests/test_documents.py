"""Documents do what they say: docs/python.md, the README's example and table, docstrings, notebooks."""

import doctest
import importlib.util
import inspect
import json
import os
import re
import tempfile
import unittest
import warnings
from pathlib import Path

import numpy as np

import rubato as rb

SOURCES = Path(os.environ.get("RUBATO_SOURCES", Path(__file__).parents[2]))


def has_all():
    """Whether all that the documents use is there."""
    if not all(importlib.util.find_spec(name) for name in ("matplotlib", "xarray", "scipy")):
        return False
    import matplotlib

    matplotlib.use("Agg")
    return True


def setUpModule():
    warnings.simplefilter("ignore", rb.RubatoWarning)


class Documents(unittest.TestCase):
    def setUp(self):
        folder = tempfile.TemporaryDirectory()
        self.addCleanup(folder.cleanup)
        before = os.getcwd()
        os.chdir(folder.name)
        self.addCleanup(os.chdir, before)
        self.addCleanup(self.close_figures)

    @staticmethod
    def close_figures():
        if has_all():
            from matplotlib import pyplot

            pyplot.close("all")

    @staticmethod
    def blocks(document):
        text = (SOURCES / document).read_text(encoding="utf-8")
        return re.findall(r"^```python\n(.*?)^```$", text, re.M | re.S)

    @unittest.skipUnless(has_all(), "matplotlib, xarray or SciPy is not installed")
    def test_the_page(self):
        blocks = self.blocks("docs/python.md")
        self.assertGreater(len(blocks), 5)
        from scipy.integrate import solve_ivp

        names = {"solve_ivp": solve_ivp}
        for block in blocks:
            exec(compile(block, "docs/python.md", "exec"), names)
        self.assertGreater(len(names["data"].data_vars), 0)
        self.assertLessEqual(len((SOURCES / "docs/python.md").read_text(encoding="utf-8").split()), 1200)

    @unittest.skipUnless(has_all(), "matplotlib, xarray or SciPy is not installed")
    def test_other_packages(self):
        """The same answers as SciPy, in at most as many lines as any package takes."""
        spec = importlib.util.spec_from_file_location("other_packages", SOURCES / "examples/python/other_packages.py")
        page = importlib.util.module_from_spec(spec)
        spec.loader.exec_module(page)
        packages = set()
        for task in page.TASKS:
            lines = {name: len(inspect.getsource(write).splitlines()) for name, write in vars(task).items()
                     if inspect.isfunction(write)}
            packages.update(lines)
            self.assertLessEqual(lines["rubato"], min(lines.values()), task)
            theirs, ours = np.asarray(task.scipy()), np.asarray(task.rubato())
            self.assertEqual(theirs.shape, ours.shape)
            self.assertLess(np.abs(theirs - ours).max(), task.tolerance, task)
            self.assertGreater(np.abs(theirs).max(), 20 * task.tolerance)  # a state of rest would not do
        self.assertEqual(packages, {"scipy", "heyoka", "rebound", "dedalus", "rubato"})

    @unittest.skipUnless(has_all(), "matplotlib, xarray or SciPy is not installed")
    def test_the_example_of_the_readme(self):
        block, = self.blocks("README.md")
        self.assertLessEqual(len(block.splitlines()), 12)
        names = {}
        exec(compile(block, "README.md", "exec"), names)
        self.assertLess(np.ptp(names["r"].energy), 1e-11)
        self.assertEqual(names["w"].verdict, "good")

    @unittest.skipUnless(has_all(), "matplotlib, xarray or SciPy is not installed")
    def test_the_table_of_the_readme(self):
        """The script that draws the README's picture prints the README's table."""
        spec = importlib.util.spec_from_file_location("comet", SOURCES / "docs/figures/comet.py")
        comet = importlib.util.module_from_spec(spec)
        spec.loader.exec_module(comet)
        table = comet.table()
        readme = (SOURCES / "README.md").read_text(encoding="utf-8")
        self.assertEqual(len(table.splitlines()), 6)
        self.assertIn(table, readme)
        self.assertNotIn(table.replace("5e-07", "6e-07"), readme)  # a changed figure is noticed

    def test_docstrings(self):
        tried = 0
        for name in ("rubato", "rubato._run", "rubato._systems", "rubato._steps", "rubato._result", "rubato._symbols",
                     "rubato._ensemble"):
            module = importlib.import_module(name)
            result = doctest.testmod(module, optionflags=doctest.ELLIPSIS)
            self.assertEqual(result.failed, 0, name)
            tried += result.attempted
        self.assertGreater(tried, 20)

    def test_everything_public_is_described(self):
        for name in rb.__all__:
            self.assertTrue((getattr(rb, name).__doc__ or "").strip(), name)

    @unittest.skipUnless(has_all(), "matplotlib, xarray or SciPy is not installed")
    def test_notebooks(self):
        notebooks = sorted((SOURCES / "examples/python").glob("*.ipynb"))
        self.assertEqual(len(notebooks), 4)
        for notebook in notebooks:
            cells = json.loads(notebook.read_text(encoding="utf-8"))["cells"]
            names = {"display": lambda value: value._repr_html_()}
            for number, cell in enumerate(cells):
                if cell["cell_type"] == "code":
                    exec(compile("".join(cell["source"]), f"{notebook.name}, cell {number}", "exec"), names)

    @unittest.skipUnless(has_all(), "matplotlib, xarray or SciPy is not installed")
    def test_every_picture(self):
        orbit = rb.run("henon-heiles-section", until=50)
        lattice = rb.run("sine-gordon", until=1)
        plane = rb.run("sine-gordon-2d", settings=["grid.x.cells=15", "grid.y.cells=15"], until=0.1)
        from rubato import _plots

        for result in (orbit, lattice, plane):
            for what in _plots.kinds(result):
                self.assertTrue(result.plot(what).has_data(), what)
            self.assertIn("<img", result._repr_html_())
        self.assertTrue(rb.converge("pendulum", until=2).plot().has_data())
        with self.assertRaisesRegex(ValueError, "orbit"):
            orbit.plot("nothing")
        for what in ("map", "field"):
            with self.assertRaisesRegex(ValueError, "orbit"):
                orbit.plot(what)
        with self.assertRaisesRegex(ValueError, "field"):
            plane.plot("orbit")


if __name__ == "__main__":
    unittest.main()
