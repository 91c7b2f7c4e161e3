"""What is integrated: Hamiltonians, Lagrangians, fields."""

from __future__ import annotations

import re

import numpy as np

from . import _core, _symbols, _toml
from ._symbols import as_formula, components

_NAME = re.compile(r"[A-Za-z_][A-Za-z0-9_]*")


def without_mask(value, what: str):
    """Returns the value, which may be an array, unless some of its numbers are hidden."""
    if isinstance(value, np.ma.MaskedArray):
        raise TypeError(f"{what} is a masked array, and every number is needed: fill it by .filled()")
    return value


def _names(value, what: str) -> list:
    if isinstance(value, str):
        value = value.replace(",", " ").split()
    value = list(value)
    if not value or not all(isinstance(name, str) for name in value):
        raise TypeError(f"{what} are names: \"x y\", or [\"x\", \"y\"], or \"r[3]\" for r1, r2, r3")
    return value


def _all_components(names: list) -> list:
    return [component for name in names for component in components(name)]


class System:
    """What Hamiltonian, Lagrangian, Field and Multisymplectic have in common.

    `text` is the system as the tables of a problem file.
    """

    _keywords: tuple = ("title", "parameters", "definitions", "invariants", "exact", "tables")

    def __init__(self, tables: dict, names: list, *, title=None, parameters=None, definitions=None, invariants=None,
                 exact=None, constraints=None, more=None, keywords=None, coordinates=(), positions=()):
        self._title = title
        self._names = list(names)
        self._definitions = dict(tables.pop("definitions", {}))
        if not isinstance(more or {}, dict) or not all(isinstance(table, dict) for table in (more or {}).values()):
            raise TypeError('tables has tables by name: {"verdict": {"accept": ["resolution"]}}')
        self._tables = {**tables, **(more or {})}
        self._parameters: dict = {}
        self._add(self._parameters, "parameter", {**(parameters or {}), **(keywords or {})})
        self._invariants: dict = {}
        self._exact: dict = {}
        self._constraints: dict = {}
        self._add(self._definitions, "definition", definitions)
        self._add(self._invariants, "invariant", invariants)
        self._add(self._exact, "exact", exact, [*coordinates, "t"])
        self._add(self._constraints, "constraint", constraints, list(positions))
        for name in keywords or {}:
            self._require_use(name)

    def _add(self, table: dict, what: str, formulas, arguments=None):
        for name, value in (formulas or {}).items():
            table[name] = self._formula(value, f"{what} {name}", arguments)

    def _require_use(self, parameter: str):
        """A keyword that no formula names is a misspelt one."""
        texts = [_toml.value_text(value) for table in self.tables().values() for key, value in table.items()
                 if key != parameter or table is not self._parameters]
        used = set(_NAME.findall(" ".join(texts)))
        if parameter not in used:
            raise _toml.unknown_keyword(type(self).__name__, parameter, used.union(self._keywords))

    def _formula(self, value, what: str, arguments=None):
        if isinstance(value, (int, float, np.integer, np.floating)) and not isinstance(value, bool):
            return value
        arguments = self._names if arguments is None else arguments
        others = [*self._parameters, *self._definitions, "t"]
        text, definitions = as_formula(value, arguments, others, what, f"{what.replace(' ', '_')}_part_")
        self._definitions.update(definitions)
        return text

    @property
    def names(self) -> list:
        """The names of the state, vectors expanded."""
        return _all_components(self._names)

    def tables(self) -> dict:
        """The tables of a problem file that state the system."""
        tables = {"": {} if self._title is None else {"title": self._title}}
        tables.update(self._tables)
        tables["parameters"] = self._parameters
        tables["definitions"] = self._definitions
        tables["invariants"] = self._invariants
        tables["exact"] = self._exact
        if self._constraints:
            tables["constraints"] = self._constraints
        return tables

    @property
    def text(self) -> str:
        return _toml.text(self.tables())

    def __repr__(self) -> str:
        return f"<rubato.{type(self).__name__} of {', '.join(self._names)}>"

    def __eq__(self, other):
        return type(self) is type(other) and self.tables() == other.tables()

    __hash__ = None


class Hamiltonian(System):
    """A system q' = H_p, p' = -H_q.

    Parameters
    ----------
    q, p : str or list of str
        Names of the coordinates and of the momenta, in the same order: ``"x y"``, or ``"r[3]"`` for r1, r2, r3.
    H : callable, str or SymPy expression
        A function of the names (of `q`, then of `p`; or by name, parameters too), which is called once with symbols;
        or a formula as in problem files; or a SymPy expression.
    title : str, optional
    parameters, definitions, invariants, exact : dict, optional
        As the tables of a problem file. Values may be functions, too.
    constraints : dict, optional
        Holonomic constraints by name: formulas, or functions, of the coordinates that vanish.
    time_scale : formula, optional
        A positive function g: the orbit in fictitious time, dt = g ds.
    tables : dict, optional
        Other tables of a problem file: ``{"verdict": {"accept": ["resolution"]}}``.
    **keywords
        Parameters by name. One that no formula names is an error.

    Examples
    --------
    >>> import numpy as np, rubato as rb
    >>> pendulum = rb.Hamiltonian(q="q", p="p", H=lambda q, p: p**2/2 - np.cos(q))
    >>> print(pendulum.text)
    [hamiltonian]
    q = ["q"]
    p = ["p"]
    H = "p^2/2 - cos(q)"
    <BLANKLINE>
    >>> kepler = rb.Hamiltonian("r[2]", "v[2]", lambda r, v, m: v @ v/2 - m/np.sqrt(r @ r), m=1)
    """

    _keywords = System._keywords + ("q", "p", "H", "constraints", "time_scale")

    def __init__(self, q, p, H, *, title=None, parameters=None, definitions=None, invariants=None, exact=None,
                 constraints=None, time_scale=None, tables=None, **keywords):
        q, p = _names(q, "q"), _names(p, "p")
        others = list(keywords) + list(parameters or {}) + list(definitions or {}) + ["t"]
        text, parts = as_formula(H, q + p, others, "H")
        stated = {"hamiltonian": {"q": q, "p": p, "H": text}, "definitions": parts}
        if time_scale is not None:
            scale, more = as_formula(time_scale, q + p, others, "time_scale", "scale_part_")
            stated["hamiltonian"]["time_scale"] = scale
            parts.update(more)
        self.q, self.p = q, p
        super().__init__(stated, q + p, title=title, parameters=parameters, definitions=definitions,
                         invariants=invariants, exact=exact, constraints=constraints, more=tables, keywords=keywords,
                         positions=q)


class Lagrangian(System):
    """A system stated by L(q, q'): the velocities are called as the coordinates, with _dot.

    Parameters
    ----------
    q : str or list of str
    L : callable, str or SymPy expression
        A function of the coordinates, then of the velocities; or by name.
    title, parameters, definitions, invariants, exact, constraints, tables, **keywords
        As of Hamiltonian.

    Examples
    --------
    >>> import numpy as np, rubato as rb
    >>> pendulum = rb.Lagrangian("q", lambda q, q_dot: q_dot**2/2 + np.cos(q))
    >>> rb.integrate(pendulum, [0, 1.9], (0, 10), step=0.1).success
    True
    """

    _keywords = System._keywords + ("q", "L", "constraints")

    def __init__(self, q, L, *, title=None, parameters=None, definitions=None, invariants=None, exact=None,
                 constraints=None, tables=None, **keywords):
        q = _names(q, "q")
        dots = [f"{name}_dot" for name in q]
        others = list(keywords) + list(parameters or {}) + list(definitions or {})
        text, parts = as_formula(L, q + dots, others, "L")
        self.q, self.q_dot = q, dots
        super().__init__({"lagrangian": {"q": q, "L": text}, "definitions": parts}, q + dots, title=title,
                         parameters=parameters, definitions=definitions, invariants=invariants, exact=exact,
                         constraints=constraints, more=tables, keywords=keywords, positions=q)


class Field(System):
    """A wave equation, by its Lagrangian density, its Hamiltonian density, or as it stands on paper.

    Parameters
    ----------
    fields : str or list of str, optional
        Names of the fields; not needed with `equation`. Equations in this place are taken as `equation`.
    L : callable or str, optional
        The density, of the fields and their derivatives u_t, u_x: the parameters of the function are their names.
    H : callable or str, optional
        The Hamiltonian density, with `structure`, and `pairs` or `psi` as in problem files.
    equation : str or list of str, optional
    title, parameters, definitions, invariants, exact, tables, **keywords
        As of Hamiltonian.
    symmetries : dict, optional
        Linear symmetries: for each name the entries [row, column, value] of its matrix.

    Examples
    --------
    >>> import numpy as np, rubato as rb
    >>> wave = rb.Field("u", L=lambda u, u_t, u_x: u_t**2/2 - u_x**2/2 - (1 - np.cos(u)))
    >>> same = rb.Field("u_tt = u_xx - sin(u)")
    """

    _keywords = System._keywords + ("fields", "L", "H", "equation", "structure", "pairs", "psi", "symmetries")

    def __init__(self, fields=None, L=None, *, H=None, equation=None, structure=None, pairs=None, psi=None,
                 symmetries=None, title=None, parameters=None, definitions=None, invariants=None, exact=None,
                 tables=None, **keywords):
        if L is None and H is None and equation is None and _are_equations(fields):
            fields, equation = None, fields
        if (L is not None) + (H is not None) + (equation is not None) != 1:
            raise TypeError("Field takes one of L, H and equation, such as Field(\"u_tt = u_xx - sin(u)\")")
        names = [] if fields is None else _names(fields, "fields")
        table = {} if fields is None else {"fields": names}
        others = list(keywords) + list(parameters or {}) + list(definitions or {}) + ["x", "y", "z", "t"]
        parts = {}
        if equation is not None:
            table["equation"] = equation
        for key, density in (("L", L), ("H", H)):
            if density is not None:
                derivatives = _arguments(density)
                table[key], parts = as_formula(density, derivatives or names, others, key)
        for key, value in (("structure", structure), ("pairs", pairs), ("psi", psi)):
            if value is not None:
                table[key] = value
        stated = {"field": table, "definitions": parts}
        if symmetries:
            stated["symmetries"] = symmetries
        super().__init__(stated, names, title=title, parameters=parameters, definitions=definitions,
                         invariants=invariants, exact=exact, more=tables, keywords=keywords,
                         coordinates=("x", "y", "z"))

    def __repr__(self) -> str:
        return f"<rubato.Field {next(iter(self._tables['field'].values()))!r}>"


def _are_equations(value) -> bool:
    texts = [value] if isinstance(value, str) else value
    return isinstance(texts, (list, tuple)) and len(texts) > 0 and all(isinstance(t, str) and "=" in t for t in texts)


def _arguments(function) -> list:
    """The names of the parameters of a function."""
    import inspect

    if not callable(function):
        return []
    return [p.name for p in inspect.signature(function).parameters.values()]


class Multisymplectic(System):
    """A wave equation M z_t + K_x z_x + ... = S'(z).

    Parameters
    ----------
    fields : str or list of str
    M : array or list of [row, column, value]
    K : the same, of one direction; or a dict of them by direction, {"x": ..., "y": ...}
    S : callable, str or SymPy expression
        A function of the fields.
    title, parameters, definitions, invariants, exact, symmetries, tables, **keywords
        As of Field.

    Examples
    --------
    >>> import numpy as np, rubato as rb
    >>> wave = rb.Multisymplectic("u v w", M=[["u", "v", -1]], K=[["u", "w", 1]],
    ...                           S=lambda u, v, w: (v**2 - w**2)/2 + 1 - np.cos(u))
    """

    _keywords = System._keywords + ("fields", "M", "K", "S", "symmetries")

    def __init__(self, fields, M, K, S, *, symmetries=None, title=None, parameters=None, definitions=None,
                 invariants=None, exact=None, tables=None, **keywords):
        names = _names(fields, "fields")
        others = list(keywords) + list(parameters or {}) + list(definitions or {}) + ["x", "y", "z", "t"]
        text, parts = as_formula(S, names, others, "S")
        stated = {"multisymplectic": {"fields": names, "M": M, "K": K if isinstance(K, dict) else {"x": K}, "S": text},
                  "definitions": parts}
        if symmetries:
            stated["symmetries"] = symmetries
        super().__init__(stated, names, title=title, parameters=parameters, definitions=definitions,
                         invariants=invariants, exact=exact, more=tables, keywords=keywords,
                         coordinates=("x", "y", "z"))


class Lattice:
    """A field on a grid, with what it begins from.

    Parameters
    ----------
    system : Field or Multisymplectic
    grid : dict
        For each direction (from, to, cells), or a table as in problem files: ``{"x": (-20, 20, 401)}``, or
        ``{"x": {"from": 0, "to": 1, "cells": 64, "left": "fixed", "right": "free"}}`` between walls.
    initial : dict
        For each field an array of the grid's shape (z, y, x), a formula, a number, or a function of the coordinates.
        A function is traced into a formula where that is possible, and called with arrays otherwise. A complex unknown,
        `psi` of Field, may be given as one: by a complex array, or a function that returns one.
    t : float
        The time of the start.

    Examples
    --------
    >>> import numpy as np, rubato as rb
    >>> wave = rb.Field(equation="u_tt = u_xx - sin(u)")
    >>> line = rb.Lattice(wave, {"x": (-20, 20, 401)}, initial={"u": 0, "u_t": lambda x: 2*rb.sech(x)})
    """

    @_toml.suggesting
    def __init__(self, system, grid, initial, *, t=0.0):
        if not isinstance(system, (Field, Multisymplectic)):
            raise TypeError(f"a lattice is of a Field or a Multisymplectic system, and not of {type(system).__name__}")
        if not isinstance(grid, dict) or not grid:
            raise TypeError('grid has an entry for each direction: {"x": (from, to, cells)}')
        if not isinstance(initial, dict):
            raise TypeError("initial has an entry for each field that is given")
        self.system = system
        self.t = float(t)
        self._grid = {}
        for axis, value in grid.items():
            if isinstance(value, dict):
                self._grid[axis] = value
            else:
                if not isinstance(value, (tuple, list)) or len(value) != 3:
                    raise TypeError(f"grid {axis} is (from, to, cells), and not {value!r}")
                start, end, cells = value
                self._grid[axis] = {"from": start, "to": end, "cells": cells}
        self._texts = {}
        self._arrays = {}
        for name, value in initial.items():
            self._take(name, value)

    def _take(self, name: str, value):
        pair = self._parts_of(name)
        if pair is not None and not isinstance(value, str):
            value = value(*self.coordinates) if callable(value) else value
            values = np.asarray(without_mask(value, f"the initial {name}"), dtype=complex)
            values = values if values.ndim else np.full(self.shape, values)
            for part, its in zip(pair, (values.real, values.imag)):
                self._take(part, its)
            return
        if callable(value) and not isinstance(value, _symbols.Symbol):
            try:
                value = _symbols.trace(value, list(self._grid), list(self.system._parameters), f"initial {name}")
            except TypeError:
                value = value(*self.coordinates) + np.zeros(self.shape)
        without_mask(value, f"the initial {name}")
        if isinstance(value, np.ndarray) and value.ndim > 0 or isinstance(value, (list, tuple)):
            array = np.asarray(value)
            if array.dtype == object or np.iscomplexobj(array) or array.dtype.kind not in "fiu":
                raise TypeError(f"the initial {name} is an array of real numbers, and not of {array.dtype}")
            self._arrays[name] = np.ascontiguousarray(array, dtype=float)
            return
        self._texts[name] = _symbols.as_text(value, what=f"initial {name}")

    def _parts_of(self, name: str):
        """The fields that are the parts of psi, psi1, psi2, ... or of its psi_t; None for other names."""
        table = self.system._tables.get("field", {})
        pairs = table.get("psi")
        if not pairs:
            usual = re.fullmatch(r"psi(\d*)(_t)?", name)
            is_complex = re.search(r"\b(i|abs2|conj)\b", str(table.get("equation", "")))
            return [part + name[3:] for part in "pq"] if usual and is_complex else None
        pairs = {"psi": pairs} if isinstance(pairs[0], str) else {f"psi{i + 1}": pair for i, pair in enumerate(pairs)}
        of = name[:-2] if name.endswith("_t") else name
        return [part + name[len(of):] for part in pairs[of]] if of in pairs else None

    @property
    def shape(self) -> tuple:
        """The number of nodes in each direction, the last one x."""
        return tuple(self._nodes(table) for table in reversed(self._grid.values()))

    @staticmethod
    def _nodes(table) -> int:
        """The number of nodes in a direction: both ends are nodes between walls."""
        return int(table["cells"]) + ("left" in table)

    @property
    def coordinates(self) -> list:
        """Arrays of the coordinates of all nodes, x first, each of the shape of the grid."""
        axes = []
        for table in self._grid.values():
            start, end, cells = self._number(table["from"]), self._number(table["to"]), int(table["cells"])
            axes.append(start + np.arange(self._nodes(table)) * ((end - start) / cells))
        return [axis.copy() for axis in np.meshgrid(*reversed(axes), indexing="ij")][::-1]

    def _number(self, value) -> float:
        """The number that an end of the grid is, which may be a formula of the parameters."""
        if not isinstance(value, str):
            return float(value)
        tables = {"hamiltonian": {"q": ["grid_q"], "p": ["grid_p"], "H": "grid_p^2"},
                  "parameters": self.system._parameters, "initial": {"t": value, "grid_q": 0, "grid_p": 1},
                  "scheme": {"step": 1, "until": f"({value}) + 1"}}
        return _core.parse_problem(_toml.text(tables), "rubato.Lattice", [], {}).start

    def tables(self) -> dict:
        tables = self.system.tables()
        initial = dict(self._texts)
        if self.t != 0.0:
            initial["t"] = self.t
        if self._arrays:
            initial.update({"from": "arrays in memory", "at": self.t, "take": list(self._arrays)})
        tables["grid"] = self._grid
        tables["initial"] = initial
        return tables

    @property
    def text(self) -> str:
        return _toml.text(self.tables())

    def __repr__(self) -> str:
        return f"<rubato.Lattice of {self.system!r} on {' x '.join(map(str, reversed(self.shape)))} nodes>"
