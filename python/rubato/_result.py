"""What a run gives back: its numbers by name, how it ended, pictures."""

from __future__ import annotations

import json
from collections.abc import Mapping

import numpy as np

from . import _core, _toml
from ._symbols import vectors


class _Arrays:
    """Datasets that were read before, as a source: what a pickled result has."""

    def __init__(self, datasets: list, arrays: dict):
        self._datasets, self._arrays = datasets, arrays

    def datasets(self) -> list:
        return self._datasets

    def read(self, path: str):
        return self._arrays[path]


class Columns(Mapping):
    """Columns below a path of the record, by name, as items or as attributes."""

    def __init__(self, result: "Result", prefix: str):
        self._result, self._prefix = result, prefix

    def _names(self) -> list:
        return [path[len(self._prefix):] for path in self._result.paths if path.startswith(self._prefix)]

    def __getitem__(self, name: str):
        if self._prefix + name not in self._result._info:
            raise KeyError(f"{name!r}{_toml.suggestion(name, self._names())}")
        return self._result._read(self._prefix + name)

    def __getattr__(self, name: str):
        if name.startswith("__"):
            raise AttributeError(name)
        try:
            return self[name]
        except KeyError as error:
            raise AttributeError(f"there is no {error.args[0]}") from None

    def __iter__(self):
        return iter(self._names())

    def __len__(self):
        return len(self._names())

    def __repr__(self):
        return f"<{self._prefix}: {', '.join(self._names())}>"

    def __dir__(self):
        return self._names()


class Crossings:
    """The crossings of one event: times `t`, states `y` (a column for each), directions, quantities."""

    def __init__(self, result: "Result", name: str):
        self.name = name
        prefix = f"/events/{name}/"
        read = lambda last: result._read(prefix + last) if prefix + last in result._info else None
        self.t, self.direction, self.quantities = read("t"), read("direction"), read("quantities")
        q, p = read("q"), read("p")
        self.y = None if q is None else result._states(q, p)

    def __len__(self):
        return len(self.t)

    def __repr__(self):
        return f"<{len(self)} crossings of {self.name}>"


class Lyapunov:
    """Growth of the tangent vectors along an orbit: [scheme] tangents, or ``tangents=4``.

    Attributes
    ----------
    exponents : array
        ln of the growth of each vector over the time, by QR; `sum` of them is 0 for all 2n vectors.
    megno : float
        MEGNO averaged over the time: about 2 on a regular orbit.
    growth : array, shape (vectors, steps)
        ln r_ii of each step that has a row.
    two_form : array, shape (steps,)
        Defect of dp^dq of the vectors in each step; None with one vector.
    """

    def __init__(self, result: "Result"):
        paths = []
        while f"/tangents/growth_{len(paths) + 1}" in result._info:
            paths.append(f"/tangents/growth_{len(paths) + 1}")
        if not paths:
            raise LookupError("the run carried no tangent vectors: give tangents=4, or tangents=\"all\"")
        figures = result.figures.get("lyapunov", {})
        self.exponents = np.array(figures.get("exponents", [np.nan] * len(paths)))
        self.megno = figures.get("megno", np.nan)
        self.growth = np.array([result._read(path) for path in paths])
        path = "/tangents/two_form"
        self.two_form = result._read(path) if path in result._info else None

    def __repr__(self):
        return f"<exponents {self.exponents}, MEGNO {self.megno:.6g}>"


class Result:
    """A run in memory, or a record.

    Attributes
    ----------
    t : array
        Times of the stored levels, or those of `t_eval`: physical ones, with `time_scale`, too.
    y : array, shape (2n, len(t))
        Of an orbit the states at `t`: coordinates, then momenta; of a Lagrangian coordinates, then velocities.
    sol : callable
        Of an orbit, ``sol(t)``: states in between, by dense output of the scheme's own order.
    energy, h : array
        The discrete energy and the length of each step; with `every`, of those that lead to stored levels.
    laws : mapping
        Local residuals (NAME_max, NAME_rms), totals and invariants.
    lyapunov : Lyapunov
        With tangents: exponents, MEGNO, and the growth of each tangent vector in each step.
    tangent : array, shape (stored levels, 2n, 2n)
        With ``tangents={"matrix": True}`` the state-transition matrix, the derivative of each stored state by the first.
    sensitivities : dict
        With ``tangents={"parameters": ["mu"]}`` the derivatives of the stored states by these parameters, as `y`.
    t_events, y_events : list of arrays
        The crossings of each event, states as columns as in `y` (solve_ivp has them as rows); `events` has them by name.
    success, status, message : how the run ended; `status` is that of the program, 0 is done.
    verdict, reasons : "good", "doubtful" or "lost", and why.
    warnings : list of str
    figures : dict
        What ``rubato run --json`` prints.

    Columns are found by name, ``r["x"]`` or ``r.x``: coordinates, momenta, fields, invariants, quantities; H is the
    energy at the levels. Of "r[3]" ``r.r`` has the shape (3, len(t)). Of an equation in psi, ``r.psi`` is complex; of a
    damped one ``r.u`` is the field as stated. ``r["/levels/gamma"]`` has any dataset by its path (docs/records.md). An
    attribute of the list above hides a column of its name, which ``r["y"]`` still finds.
    """

    def __init__(self, source, problem, ending=None, *, file=None, names=()):
        self._source = source
        self._problem = problem
        self._cache: dict = {}
        self._info = {path: (dimensions, description, text)
                      for path, dimensions, description, text in source.datasets()}
        self._event_order = list(names)
        self.file = file
        self.title = problem.title
        self.problem = problem.text
        if ending is None:
            self.status, self.message, self.warnings, self.verdict = 0, "", [], ""
            self.table, self._json = "", None
        else:
            self.status, self.message, self.warnings = ending.status, ending.message, ending.warnings
            self.verdict, self.table, self._json = ending.verdict, ending.table, ending.json
        self._columns = self._find_columns()

    # -- datasets

    @property
    def paths(self) -> list:
        """The paths of all datasets."""
        return list(self._info)

    def _read(self, path: str):
        if path not in self._cache:
            self._cache[path] = self._source.read(path)
        return self._cache[path]

    def _find_columns(self) -> dict:
        columns = {}
        where = "/output/" if self._has_output_states() else "/states/"
        if not self._problem.is_lattice:
            for group, names in (("q", self._problem.q), ("p", self._problem.p), ("q_dot", self._problem.q_dot)):
                path = (where if f"{where}{group}" in self._info else "/states/") + group
                if path in self._info:
                    columns.update({name: (path, i) for i, name in enumerate(names)})
        else:
            for name, *_ in self._problem.axes:
                columns[name] = (f"/grid/{name}", None)
            for name in self._problem.fields:
                for path in (f"{where}{name}", f"/states/{name}", f"/states/midpoints/{name}"):
                    if path in self._info:
                        columns.setdefault(name, (path, None))
            for name, rate, *parts in self._problem.unknowns:
                if all(field in columns for part in parts for field, _ in part):
                    columns.setdefault(name, (None, (rate, *parts)))
        for path in self._info:
            group, _, name = path.rpartition("/")
            if group in ("/laws", "/output/quantities"):
                columns.setdefault(name, (path, None))
        for name, path in (("H", "/levels/node_energy"), ("E", "/levels/energy"), ("h", "/levels/h"),
                           ("gamma", "/levels/gamma"), ("off_law", "/levels/off_law"),
                           ("step_potential", "/levels/step_potential")):
            if path in self._info:
                columns.setdefault(name, (path, None))
        if not self._problem.is_lattice:
            for names in (self._problem.q, self._problem.p, self._problem.q_dot):
                for vector, parts in vectors(names).items():
                    if all(part in columns for part in parts):
                        columns.setdefault(vector, (columns[parts[0]][0], [columns[part][1] for part in parts]))
        return columns

    def _unknown(self, name: str, rate: float, re: list, im: list):
        """The u of a damped equation, or a complex psi, of the fields that stand for it."""
        if name not in self._cache:
            real, imaginary = (sum(factor * self[field] for field, factor in part) for part in (re, im))
            values = real + 1j * imaginary if im else real
            if rate != 0.0:
                values = values * np.exp(-rate * self.t).reshape((-1,) + (1,) * (values.ndim - 1))
            self._cache[name] = values
        return self._cache[name]

    def _has_output_states(self) -> bool:
        return "/output/q" in self._info or any(f"/output/{name}" in self._info for name in self._problem.fields)

    def __getitem__(self, name: str):
        if name in self._columns:
            path, place = self._columns[name]
            if path is None:
                return self._unknown(name, *place)
            values = self._read(path)
            return values if place is None else values[:, place].T
        if name in self._info:
            return self._read(name)
        if name == "t":
            return self.t
        raise KeyError(f"{name!r}{_toml.suggestion(str(name), list(self._columns) + self.paths)}")

    def __getattr__(self, name: str):
        if name.startswith("_") or "_columns" not in self.__dict__:
            raise AttributeError(name)
        if name in self._columns:
            return self[name]
        if name in ("y", "sol"):  # the property had none
            raise AttributeError(self._why_no_states(name))
        known = list(self._columns) + [word for word in dir(type(self)) if not word.startswith("_")]
        raise AttributeError(f"the result has no {name!r}{_toml.suggestion(name, known)}")

    def __dir__(self):
        return list(super().__dir__()) + list(self._columns)

    def __contains__(self, name) -> bool:
        return name in self._columns or name in self._info

    # -- scipy's names

    @property
    def t(self):
        if self._has_output_states():
            return self._read("/output/t")
        return self._read("/states/q")[:, -1] if self._problem.has_clock else self._read("/states/t")

    def _why_no_states(self, name: str) -> str:
        if not self._problem.is_lattice:
            return "sol needs the states of all levels: leave out every"
        field = self._problem.fields[0]
        return f"a lattice has no sol: give t_eval for the times of the states, r[\"{field}\"]" if name == "sol" else \
            f"a lattice has its fields by name: r[\"{field}\"]"

    @property
    def y(self):
        if self._problem.is_lattice:
            if "y" in self._columns:
                return self["y"]
            raise AttributeError(self._why_no_states("y"))
        if "y of scipy" not in self._cache:
            where = "/output/" if self._has_output_states() else "/states/"
            velocities = self._read(where + "q_dot") if where + "q_dot" in self._info else None
            self._cache["y of scipy"] = self._states(self._read(where + "q"), self._read(where + "p"), velocities)
        return self._cache["y of scipy"]

    def _states(self, q, p, velocities=None):
        """States in the form of `y`."""
        if self._problem.q_dot and velocities is None:
            return _core.read_states(self._problem, q, p).T
        pairs = self._problem.pairs
        return np.concatenate([q[:, :pairs], (p if velocities is None else velocities)[:, :pairs]], axis=1).T

    @property
    def success(self) -> bool:
        return self.status == 0

    @property
    def sol(self):
        if self._problem.is_lattice:
            raise AttributeError(self._why_no_states("sol"))
        if "parts" in self.__dict__:
            return self._sol_of_parts()
        t = self._read("/states/q")[:, -1] if self._problem.has_clock else self._read("/states/t")
        if self._read("/states/level")[-1] != len(t) - 1:
            raise AttributeError(self._why_no_states("sol"))
        q, p = self._read("/states/q"), self._read("/states/p")
        y = self._states(q, p, self._read("/states/q_dot") if self._problem.q_dot else None).T
        dense = _core.DenseOutput(self._problem, t, q, p, self._read("/levels/h"), y)

        def sol(t):
            """Returns the states at the times t, one column for each."""
            times = np.asarray(t, dtype=float)
            rows = dense.at(np.atleast_1d(times).ravel())
            return rows[0] if times.ndim == 0 else rows.T

        return sol

    def _sol_of_parts(self):
        """Of a run that was reset: at a reset the state after it."""
        pieces, resets = [part.sol for part in self.parts], np.array([t for t, *_ in self.resets])
        direction = 1.0 if self.t[-1] >= self.t[0] else -1.0

        def sol(t):
            """Returns the states at the times t, one column for each."""
            times = np.atleast_1d(np.asarray(t, dtype=float))
            which = np.searchsorted(direction * resets, direction * times.ravel(), side="right")
            which = np.minimum(which, len(pieces) - 1)
            columns = [pieces[i](time) for i, time in zip(which, times.ravel())]
            return columns[0] if np.ndim(t) == 0 else np.array(columns).T

        return sol

    @property
    def events(self) -> dict:
        names = self._event_order or self._problem.events
        return {name: Crossings(self, name) for name in names}

    @property
    def t_events(self):
        return [crossings.t for crossings in self.events.values()] or None

    @property
    def y_events(self):
        return [crossings.y for crossings in self.events.values()] or None

    # -- ours

    @property
    def lyapunov(self) -> Lyapunov:
        return Lyapunov(self)

    @property
    def tangent(self):
        return self._read(self._tangents("/tangents/matrix", '{"matrix": True}'))

    @property
    def sensitivities(self) -> dict:
        values = self._read(self._tangents("/tangents/sensitivities", '{"parameters": ["mu"]}'))
        names = self._read("/tangents/parameter")
        return {str(name): values[:, i, :].T for i, name in enumerate(names)}

    def _tangents(self, path: str, how: str) -> str:
        if path not in self._info:
            raise LookupError(f"the run has no {path}: give tangents={how}")
        return path

    @property
    def energy(self):
        return self._read("/levels/energy")

    @property
    def h(self):
        return self._read("/levels/h")

    @property
    def laws(self) -> Columns:
        return Columns(self, "/laws/")

    @property
    def levels(self) -> Columns:
        return Columns(self, "/levels/")

    @property
    def exact(self) -> Columns:
        return Columns(self, "/exact/")

    @property
    def form(self) -> str:
        """M, K and S as they were derived from an equation or a density."""
        return self._problem.form

    @property
    def figures(self) -> dict:
        if self._json is None:
            self._json = json.dumps(json.loads(_core.compare(self.file, self.file)[0])["records"][0])
        return json.loads(self._json) if self._json else {}

    @property
    def solution(self) -> dict:
        """What is known of the solution of a boundary-value problem (rubato.solve): `residual` and `correction` after
        every iteration of Newton's method, `multipliers`, `conjugate_point`, `morse_index`; empty for a run."""
        found = {path.rpartition("/")[2]: self._read(path) for path in self._info if path.startswith("/solve/")}
        if "multiplier_real" in found:
            found["multipliers"] = found.pop("multiplier_real") + 1j * found.pop("multiplier_imaginary")
        if "morse_index" in found:
            found["morse_index"] = int(found["morse_index"][0])
        return found

    @property
    def reasons(self) -> list:
        return self.figures.get("reasons", [])

    def to_xarray(self):
        """Returns an xarray.Dataset of the states, with named dimensions, coordinates and descriptions."""
        import xarray

        where = "/output/" if self._has_output_states() else "/states/"
        data, coordinates = {}, {"t": ("t", self.t)}
        axes = [name for name, *_ in self._problem.axes]
        for name in axes:
            coordinates[name] = (name, self._read(f"/grid/{name}"))
            shift = self.shift(name)
            if shift is not None:
                coordinates[f"{name}_shift"] = ("t", shift, {"description": f"the nodes are at {name} + {name}_shift"})
        pairs = 0 if axes else self._problem.pairs
        for name in self._problem.fields or self._problem.q[:pairs] + self._problem.p[:pairs]:
            path, place = self._columns[name]
            if path.startswith(where):
                data[name] = (["t"] + axes[::-1], self[name], {"description": self._info[path][1]})
        if not axes:  # a coordinate of an orbit may be called t as well, or as a dimension
            data = {name: entry for name, entry in data.items() if name != "t"}
        return xarray.Dataset(data, coordinates, {"title": self.title, "problem": self.problem})

    def shift(self, axis: str = "x"):
        """How far the nodes of a moving frame are from `axis` at the times `t`; None without one, and with `t_eval`."""
        if "/frame/shift" not in self._info or self._has_output_states():
            return None
        shifts = self._read("/frame/shift")
        return shifts if shifts.ndim == 1 else shifts[:, [name for name, *_ in self._problem.axes].index(axis)]

    def to_dict(self) -> dict:
        """Returns all datasets by their paths."""
        return {path: self._read(path) for path in self.paths}

    def plot(self, what=None, **options):
        """Draws the result with matplotlib: see rubato.plot."""
        from . import _plots

        return _plots.plot(self, what, **options)

    def page(self, file=None):
        """Returns the report of a record as one page of HTML, or writes it into `file`."""
        if self.file is None:
            raise ValueError("a report is made of a record: give the run a file")
        text = _core.Reader(self.file).page()
        if file is None:
            return text
        with open(file, "w", encoding="utf-8") as page:
            page.write(text)
        return file

    def __repr__(self) -> str:
        end = f"t = {self.t[-1]:.10g}" if len(self.t) else "nothing"
        parts = [f"<rubato.Result of {self.title!r} to {end}", f"{self.figures.get('steps', len(self.energy))} steps"]
        if self.verdict:
            parts.append(self.verdict)
        if self.message:
            parts.append(self.message)
        return ", ".join(parts) + ">"

    def _repr_html_(self) -> str:
        from . import _plots

        return _plots.html(self)

    def in_memory(self) -> "Result":
        """Returns the same result without its record."""
        copy = Result.__new__(Result)
        copy.__setstate__({**self.__getstate__(), "file": None})
        return copy

    # -- pickling

    def __getstate__(self) -> dict:
        state = {key: value for key, value in self.__dict__.items() if key not in ("_source", "_problem", "_cache")}
        state["arrays"] = {path: np.array(value) if isinstance(value, np.ndarray) else value
                           for path, value in self.to_dict().items()}
        state["datasets"] = self._source.datasets()
        return state

    def __setstate__(self, state: dict):
        arrays, datasets = state.pop("arrays"), state.pop("datasets")
        self.__dict__.update(state)
        self._source = _Arrays(datasets, arrays)
        self._cache = {}
        self._problem = _core.parse_problem(self.problem, "pickled", [], {})


class Summary:
    """What a check, a comparison, a scan or a study of convergence found.

    `figures` is the program's JSON, and `summary["KEY"]` one of its entries; `table` is for people.
    """

    def __init__(self, table: str, figures: str, *, status: int = 0, message: str = "", warnings=(), file=None):
        self.table = table
        self.figures = json.loads(figures) if figures else {}
        self.status, self.message, self.warnings, self.file = status, message, list(warnings), file

    @property
    def success(self) -> bool:
        return self.status == 0

    def __getitem__(self, name: str):
        if name not in self.figures:
            raise KeyError(f"{name!r}{_toml.suggestion(name, list(self.figures))}")
        return self.figures[name]

    def plot(self, *, axes=None):
        """Draws the estimated errors of a study of convergence over the step, by the observed orders."""
        from . import _plots

        return _plots.convergence(self, axes)

    def __str__(self) -> str:
        return self.table

    def __repr__(self) -> str:
        return self.table.rstrip("\n") or f"<rubato.Summary: {self.message}>"

    def _repr_html_(self) -> str:
        import html

        return f"<pre>{html.escape(self.table)}</pre>"
