"""From the arguments of integrate() to a problem."""

from __future__ import annotations

import os

import numpy as np

from . import _core, _symbols, _toml
from ._systems import Field, Hamiltonian, Lagrangian, Lattice, Multisymplectic, without_mask


def numbers(value, count: int, what: str) -> list:
    """Returns so many finite or infinite real numbers of an array, as floats."""
    array = np.asarray(without_mask(value, what))
    if array.dtype == object or array.dtype.kind not in "fiu":
        raise TypeError(f"{what} takes real numbers, and not {value!r}")
    if array.shape != (count,):
        raise ValueError(f"{what} has shape {array.shape}, and is to have ({count},)")
    return [float(number) for number in array]


def real(value, what: str) -> float:
    is_number = isinstance(value, (int, float, np.integer, np.floating)) and not isinstance(value, bool)
    if not is_number or not np.isfinite(value):
        raise TypeError(f"{what} is a finite number, and not {value!r}")
    return float(value)


def span(t_span) -> tuple:
    if not isinstance(t_span, (tuple, list, np.ndarray)) or len(t_span) != 2:
        raise TypeError(f"t_span is (start, end), and not {t_span!r}")
    return tuple(real(t, "a time of t_span") for t in t_span)


def path_of(value) -> str:
    path = os.fspath(value)
    if not isinstance(path, str) or "\0" in path:
        raise TypeError(f"a path is a text, and not {path!r}")
    return path


def threads_of(threads) -> int:
    if isinstance(threads, bool) or not isinstance(threads, (int, np.integer)) or not 0 <= threads <= 1024:
        raise ValueError(f"threads is a number from 1 to 1024, or 0 for the usual one, and not {threads!r}")
    return int(threads)


#: Keywords of integrate() beside its own, each a key of one of these tables of a problem file.
_option_tables = ("scheme", "output")
_no_options = {"scheme": ("lagrangian", "until", "step"), "output": ("file", "times", "quantities", "every")}


def _options() -> dict:
    return {key: table for table in _option_tables for key in _toml.keys(table) if key not in _no_options[table]}


def _title(stated) -> str:
    for table in stated._tables.values():
        for key in ("H", "L", "equation", "S"):
            if isinstance(table.get(key), str) and len(table[key]) <= 60:
                return table[key] if key == "equation" else f"{key} = {table[key]}"
    return f"{type(stated).__name__} of {', '.join(stated._names)[:60]}"


def build(system, initial, t_span, *, step, scheme=None, stages=None, levels=None, t_eval=None, every=None,
          events=(), quantities=None, options=None, settings=None, function="integrate"):
    """Returns the problem of integrate(), read and checked, as a _core.Problem."""
    if isinstance(system, (Field, Multisymplectic)):
        raise TypeError(f"{function} takes a field on a grid: Lattice(system, grid, initial)")
    if not isinstance(system, (Hamiltonian, Lagrangian, Lattice)):
        raise TypeError(f"{function} takes a Hamiltonian, a Lagrangian or a Lattice, and not {type(system).__name__}; "
                        "rubato.run takes problem files and names of the catalogue")
    is_lattice = isinstance(system, Lattice)
    if is_lattice and t_span is None:
        initial, t_span = None, initial
    known = _options()
    for key in options or {}:
        if key == "until":
            raise TypeError(f"{function} takes no keyword 'until': give t_span = (start, until)")
        if key not in known:
            raise _toml.unknown_keyword(function, key, [*known, *_own_keywords])
    if t_span is None:
        raise TypeError(f"{function} takes t_span = (start, end)")
    if step is None:
        raise TypeError(f"{function} takes step, the length of the first one, or step=\"auto\" with energy_tolerance")
    start, end = span(t_span)
    stated = system.system if is_lattice else system
    names, others = stated.names, [*stated._parameters, "t", *stated.names]
    tables = system.tables()
    if "title" not in tables[""]:
        tables[""] = {"title": _title(stated)}
    if is_lattice and initial is not None:
        raise TypeError("a Lattice has its initial data")
    tables["initial"] = _started(tables["initial"] if is_lattice else _initial_table(names, initial), start)
    tables["scheme"] = _scheme_table(system, scheme, stages, levels, step, end)
    tables["output"] = _output_table(every, t_eval)
    for key, value in (options or {}).items():
        tables[known[key]][key] = value
    if quantities:
        tables["output.quantities"] = {
            name: _symbols.as_text(value, stated._names, others, f"quantity {name}")
            for name, value in quantities.items()}
    for event in events:
        tables["section" if event.name == "section" else f"events.{event.name}"] = event.table(stated._names, others)
    return _core.parse_problem(_toml.text(tables), "rubato." + function, list(settings or ()),
                               system._arrays if is_lattice else {})


def _started(initial: dict, start: float) -> dict:
    """[initial] with the time of the start."""
    table = {key: value for key, value in initial.items() if key != "t"}
    if start != 0.0:
        table = {"t": start, **table}
    return {**table, "at": start} if "at" in table else table


def _scheme_table(system, scheme, stages, levels, step, end) -> dict:
    # Of constraints of an H Gauss's scheme knows nothing.
    if scheme is None and (isinstance(system, Lagrangian) or
                           isinstance(system, Hamiltonian) and not system._constraints):
        scheme = "gauss"
    if stages is None and scheme == "gauss":
        stages = 3
    table = {"lagrangian": scheme, "stages": stages, "levels": levels,
             "step": step if isinstance(step, str) else real(step, "step"), "until": end}
    return {key: value for key, value in table.items() if value is not None}


def _output_table(every, t_eval) -> dict:
    table = {} if every is None else {"every": every}
    if t_eval is not None:
        times = np.asarray(without_mask(t_eval, "t_eval"), dtype=float)
        if times.ndim != 1 or not len(times):
            raise ValueError(f"t_eval has shape {times.shape}, and is to be a list of times, one or more")
        table["times"] = times
    return table


_own_keywords = ("initial", "t_span", "step", "scheme", "stages", "levels", "t_eval", "events", "every", "quantities",
                 "settings", "file", "overwrite", "threads", "progress")


def _initial_table(names: list, initial) -> dict:
    if initial is None:
        raise TypeError(f"initial is missing: numbers for {', '.join(names)}")
    if isinstance(initial, dict):
        for name in initial:
            if not isinstance(name, str):
                raise TypeError(f"initial has names, and not {name!r}")
        return {name: value if isinstance(value, (str, list, tuple)) else
                _symbols.as_text(value) if isinstance(value, _symbols.Symbol) else value
                for name, value in initial.items()}
    return dict(zip(names, numbers(initial, len(names), "initial")))
