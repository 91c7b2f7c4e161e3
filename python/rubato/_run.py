"""Running: integrate, run, resume, check, scan, converge, solve, compare, open."""

from __future__ import annotations

import os
import sys
import time
import warnings

import numpy as np

from . import _core, _toml
from ._ensemble import EnsembleResult, integrate_many
from ._events import as_events
from ._problem import build, numbers, path_of, real, span, threads_of
from ._result import Result, Summary
from ._steps import refuse_resets
from ._systems import Hamiltonian, Lagrangian, Lattice


class RubatoWarning(UserWarning):
    """What a run warns of: each one sentence, with the remedy."""


class Interrupted(KeyboardInterrupt):
    """Ctrl-C ended a run: `result` has the levels up to there, of an ensemble the members that were done."""

    def __init__(self, result):
        super().__init__(getattr(result, "message", "") or f"{(result.status == 130).sum()} members were not finished")
        self.result = result


class _Bar:
    """Progress of runs that take longer than a second: a line in a terminal, a bar in a notebook."""

    def __init__(self, wanted):
        self.in_notebook = "ipykernel" in sys.modules
        self.wanted = sys.stderr.isatty() or self.in_notebook if wanted is None else bool(wanted)
        self.begun = time.monotonic()
        self.display = None
        self.shown = False

    def __call__(self, t, start, until, steps, members):
        passed = time.monotonic() - self.begun
        if passed < 1.0:
            return
        done = t / members if members else (t - start) / (until - start)
        left = passed * (1.0 - done) / done if done > 0 else 0.0
        where = f"{int(t)} of {members} members" if members else f"t = {t:.6g} of {until:.6g}, {steps} steps"
        self._show(done, f"{where}, {left:.0f} s left")
        self.shown = True

    def _show(self, done, text):
        if not self.in_notebook:
            sys.stderr.write(f"\r{100.0 * done:5.1f} %  {text} \x1b[K")
            sys.stderr.flush()
            return
        from IPython.display import HTML, display

        bar = HTML(f'<progress value="{done:.4f}" max="1"></progress> {text}' if text else "")
        if self.display is None:
            self.display = display(bar, display_id=True)
        else:
            self.display.update(bar)

    def close(self):
        if self.shown and self.in_notebook:
            self._show(1.0, "")
        elif self.shown:
            sys.stderr.write("\r\x1b[K")
            sys.stderr.flush()


def _with_progress(progress, work):
    """Calls work(callback or None)."""
    if callable(progress):
        return work(lambda t, start, until, steps, members: progress(t, until))
    bar = _Bar(progress)
    try:
        return work(bar if bar.wanted else None)
    finally:
        bar.close()


def _warn(sentences):
    """Warnings of the line outside of the package that called it."""
    frame, level = sys._getframe(1), 2
    while frame is not None and frame.f_globals.get("__name__", "").partition(".")[0] == "rubato":
        frame, level = frame.f_back, level + 1
    for sentence in sentences:
        warnings.warn(sentence, RubatoWarning, stacklevel=level)


def _doubts(result) -> list:
    """Why a result is not good, but for what its warnings say."""
    told = " ".join(result.warnings)
    return [f"{result.verdict}: {reason['finding']}; {reason['remedy']}"
            for reason in result.figures.get("reasons", ()) if reason["what"] != "end" and reason["finding"] not in told]


def _finish(result: Result) -> Result:
    _warn(result.warnings)
    if isinstance(result, Result) and result.verdict in ("doubtful", "lost"):
        _warn(_doubts(result))
    if result.status == 130:
        raise Interrupted(result)
    return result


def _run(problem, *, file=None, overwrite=False, threads=0, progress=None, tangents=False, names=()) -> Result:
    threads = threads_of(threads)
    if file is None and not problem.is_ensemble:
        ending, rows = _with_progress(progress, lambda tick: _core.run_in_memory(problem, tangents, threads, tick))
        return Result(_core.Memory(rows), problem, ending, names=names)
    path = path_of(file)
    ending = _with_progress(progress, lambda tick: _core.run(problem, path, overwrite, tangents, threads, tick))
    if problem.is_ensemble:
        return _of_members(_core.Reader(path), ending, path)
    return Result(_core.Reader(path), problem, ending, file=path, names=names)


def _of_members(reader, ending=None, file=None) -> Summary:
    """What the record of an ensemble holds: `members` has each of its columns."""
    how = {} if ending is None else dict(status=ending.status, message=ending.message, warnings=ending.warnings)
    table = ending.table if ending else ""
    if file is None:  # the record is gone
        how["message"] = how["message"].partition("; continue with")[0]
        table = "".join(line for line in table.splitlines(True) if not line.startswith("  record "))
    summary = Summary(table, ending.json if ending else "", file=file, **how)
    summary.members = {path[len("/members/"):]: reader.read(path) for path, *_ in reader.datasets()
                       if path.startswith("/members/")}
    return summary


def integrate(system, initial=None, t_span=None, *, step=None, scheme=None, stages=None, levels=None, t_eval=None,
              events=None, every=None, quantities=None, settings=None, file=None, overwrite=False, threads=0,
              progress=None, **options):
    """Integrates a system and returns a Result.

    Parameters
    ----------
    system : Hamiltonian, Lagrangian or Lattice
    initial : array, shape (2n,), or dict
        Coordinates, then momenta (of a Lagrangian velocities); or numbers and formulas by name. An array of shape
        (members, 2n) is an ensemble, and an EnsembleResult comes back. A Lattice has its own.
    t_span : (start, end)
    step : float
        The first step; "auto" chooses it for the keyword `energy_tolerance`.
    scheme : str
        "gauss" (the default of orbits, with 3 stages, order 6, unless `stages` says otherwise; of an H with
        constraints it is "midpoint"), "midpoint", "splitting", ...
    levels : {"variable", "fixed"}
    t_eval : array, optional
        Times of the states that come back; otherwise those of the levels.
    events : Event, callable, str, list or dict of these, optional
    every : int, optional
        Every n-th level is stored.
    quantities : dict, optional
        Formulas that are stored at the same times.
    settings : list of str, optional
        Entries of the problem by path, as of ``rubato run --set``: ``["laws.every=10"]``.
    file : path, optional
        The record to write; in memory otherwise. `overwrite` replaces one.
    threads : int, optional
    progress : bool or callable, optional
        A progress line, or what is called as progress(t, end).
    **options
        The keys of [scheme] and [output] of problem files: `composition`, `step_potential`, `order`, `tolerance`, ...

    Examples
    --------
    >>> import numpy as np, rubato as rb
    >>> pendulum = rb.Hamiltonian("q", "p", lambda q, p: p**2/2 - np.cos(q))
    >>> r = rb.integrate(pendulum, [0, 1.9], (0, 20), step=0.1)
    >>> bool(np.ptp(r.energy) < 1e-12)
    True
    >>> r.y.shape == (2, len(r.t))
    True
    """
    listed = as_events(events)
    common = dict(step=step, scheme=scheme, stages=stages, levels=levels, t_eval=t_eval, every=every,
                  quantities=quantities, options=options, settings=settings)
    if isinstance(system, (Hamiltonian, Lagrangian)) and not isinstance(initial, dict) and np.ndim(initial) == 2:
        if file is not None:
            raise ValueError("an ensemble from an array stays in memory: leave out file, or use rubato.scan")
        many = _with_progress(progress, lambda tick: integrate_many(system, initial, t_span, events=listed,
                                                                    threads=threads, tick=tick, common=common))
        return _finish_many(many)
    problem = build(system, initial, t_span, events=listed, **common)
    names = [event.name for event in listed]
    if any(event.reset is not None for event in listed):
        refuse_resets(system, listed)
        if file is not None or t_eval is not None or every is not None:
            raise ValueError("with reset leave out file, t_eval and every: the result's sol(t) has states at any time")
        return _with_resets(system, problem, t_span, listed, threads, progress, common)
    return _finish(_run(problem, file=file, overwrite=overwrite, threads=threads, progress=progress, names=names))


def _finish_many(many: EnsembleResult) -> EnsembleResult:
    if many._judgement is not None:
        _warn(many.warnings)
    if (many.status == 130).any():
        raise Interrupted(many)
    return many


def _with_resets(system, problem, t_span, events, threads, progress, common):
    """Runs up to each crossing with a reset, and on from the state that it returns."""
    from ._joined import join

    start, end = span(t_span)
    parts, resets, reset_by, t = [], [], [], start
    while True:
        part = _run(problem, threads=threads, progress=progress, names=[event.name for event in events])
        parts.append(part)
        hit = [(crossings.t[0], event, crossings) for event, crossings in
               zip(events, part.events.values()) if event.reset is not None and len(crossings)]
        if part.status != 0 or not hit:
            break
        t, event, crossings = min(hit, key=lambda entry: abs(entry[0] - t))
        before = crossings.y[:, 0]
        state = event.reset(float(t), before.copy())
        if state is None:
            break
        state = numbers(state, len(system.names), "what reset returns")
        resets.append((float(t), before, np.array(state)))
        reset_by.append(event.name)
        if (end - t) * (end - start) <= 0:
            break
        problem = build(system, state, (float(t), end), events=events, **dict(common, step=float(part.h[-1])))
    return _finish(join(parts, resets, reset_by))


def _settings(overrides: dict, settings) -> list:
    """Keywords of rubato.run as entries of --set: step, or parameters__c for parameters.c."""
    tables = {}
    for table in ("scheme", "output", "laws", "grid", "initial", "parameters"):
        for key in _toml.keys(table):
            tables.setdefault(key, []).append(table)
    listed = list(settings or ())
    for key, value in overrides.items():
        if "__" in key:
            path = key.replace("__", ".")
        else:
            where = [table for table in tables.get(key, []) if table in ("scheme", "output")]
            if len(where) != 1:
                known = [name for name, its in tables.items() if its[0] in ("scheme", "output")]
                raise _toml.unknown_keyword("run", key, known + list(_run_keywords)) from None
            path = f"{where[0]}.{key}"
        listed.append(f"{path}={_toml.value_text(value)}")
    return listed


def _problem_of(problem, overrides: dict, settings, function: str):
    """The problem of run() and its like: of a file, of the catalogue, or of a system with keywords of integrate()."""
    if isinstance(problem, (Hamiltonian, Lagrangian, Lattice)):
        how = {name: overrides.pop(name, None) for name in ("step", "scheme", "stages", "levels")}
        return build(problem, overrides.pop("initial", None), overrides.pop("t_span", None), options=overrides,
                     settings=settings, function=function, **how)
    return _core.read_problem(path_of(problem), _settings(overrides, settings))


_run_keywords = ("output", "overwrite", "settings", "threads", "progress", "tangents")


def run(problem, output=None, *, overwrite=False, settings=None, threads=0, progress=None, tangents=False, **overrides):
    """Runs a problem file, or a problem of the catalogue, and returns a Result.

    Parameters
    ----------
    problem : path or str, or a system with `initial`, `t_span` and other keywords of integrate()
    output : path, optional
        The record to write. Without it the run stays in memory, but that of a problem with [ensemble].
    settings : list of str, optional
        As of ``rubato run --set``: ``["parameters.c=0.9"]``.
    tangents : bool, int, "all" or dict
        Of a lattice carries two tangent solutions along. Of an orbit the entry of [scheme]: so many tangent vectors
        (True: two), or ``{"vectors": "all", "matrix": True, "parameters": ["mu"]}``.
    **overrides
        Keys of [scheme] and [output], and any other entry with two underscores for the dot: ``parameters__c=0.9``.

    Examples
    --------
    >>> import rubato as rb
    >>> r = rb.run("kepler", parameters__e=0.3, until=20)
    >>> r.verdict
    'good'
    """
    if tangents is not False and tangents is not None:
        read = _problem_of(problem, dict(overrides), settings, "run")
        if not read.is_lattice:  # an entry of the problem, which its record has
            number = 2 if tangents is True else tangents
            settings, tangents = [*(settings or ()), f"scheme.tangents={_toml.value_text(number)}"], False
    read = _problem_of(problem, overrides, settings, "run")
    if output is None and read.is_ensemble:
        output = read.file
    return _finish(_run(read, file=output, overwrite=overwrite, threads=threads, progress=progress, tangents=bool(tangents)))


def open(file) -> Result:
    """Opens a record as a Result, that of an ensemble as a Summary; numbers are read when they are asked for."""
    path = path_of(file)
    reader = _core.Reader(path)
    if reader.is_ensemble:
        return _of_members(reader, file=path)
    problem = _core.parse_problem(reader.header["problem"], path, [], {})
    result = Result(reader, problem, file=path)
    result.verdict = result.figures.get("verdict", "")
    if not reader.header["finished"]:
        result.status, result.message = 130, "the run has not reached its end: rubato.resume continues it"
    return result


@_toml.suggesting
def resume(file, until=None, *, threads=0, progress=None) -> Result:
    """Continues a record from its last level, bit for bit as if it had never stopped, and returns its Result."""
    path = path_of(file)
    until = None if until is None else real(until, "until")
    ending = _with_progress(progress, lambda tick: _core.resume(path, until, threads_of(threads), tick))
    reader = _core.Reader(path)
    if reader.is_ensemble:
        return _finish(_of_members(reader, ending, path))
    problem = _core.parse_problem(reader.header["problem"], path, [], {})
    return _finish(Result(reader, problem, ending, file=path))


@_toml.suggesting
def check(file, *, replay=False) -> Summary:
    """Recomputes all that a record stores from its states and compares: `status` 6 where something disagrees."""
    ending = _core.check(path_of(file), bool(replay))
    return Summary(ending.table, ending.json, status=ending.status, message=ending.message, warnings=ending.warnings,
                   file=path_of(file))


def scan(problem, values: dict, output=None, *, overwrite=False, settings=None, threads=0, progress=None, **overrides):
    """Runs a problem for all combinations of values of its entries, and returns a Summary with one row for each.

    Parameters
    ----------
    problem : as of run()
    values : dict
        For each entry its values, or "from:to:count": ``{"initial.p": np.linspace(0.1, 3, 30)}``.
    output : path, optional
        The record of the ensemble; without it a temporary one is made and removed.

    Examples
    --------
    >>> import rubato as rb
    >>> table = rb.scan("pendulum", {"initial.p": [1.0, 1.5]}, until=10)
    >>> table["members"]
    2
    """
    if not isinstance(values, dict) or not values:
        raise TypeError('values has entries and their values: {"initial.p": [1.0, 1.5]}')
    grid = [f"ensemble.grid.{path}={_toml.value_text(these)}" for path, these in values.items()]
    read = _problem_of(problem, overrides, [*(settings or ()), *grid], "scan")
    with _Place(output) as place:
        ending = _with_progress(progress, lambda tick: _core.run(read, place, overwrite or output is None, False,
                                                                 threads_of(threads), tick))
        return _finish(_of_members(_core.Reader(place), ending, None if output is None else place))


class _Place:
    """The path of a record: the one asked for, or one in a temporary folder."""

    def __init__(self, output):
        self.output, self.folder = output, None

    def __enter__(self) -> str:
        if self.output is not None:
            return path_of(self.output)
        import tempfile

        self.folder = tempfile.TemporaryDirectory(prefix="rubato-")
        return os.path.join(self.folder.name, "record.h5")

    def __exit__(self, *_):
        if self.folder is not None:
            self.folder.cleanup()


def converge(problem, tolerance=None, *, settings=None, threads=0, progress=None, **overrides) -> Summary:
    """Runs a problem with its step, a half and a quarter of it, and estimates how accurate it is.

    `problem` and the keywords are those of run(); `tolerance` asks for the step that would reach it.

    Examples
    --------
    >>> import rubato as rb
    >>> study = rb.converge("pendulum", until=5)
    >>> study.success
    True
    """
    read = _problem_of(problem, overrides, settings, "converge")
    if tolerance is not None and real(tolerance, "tolerance") <= 0:
        raise ValueError(f"tolerance is above 0, and not {tolerance!r}")
    ending = _with_progress(progress, lambda tick: _core.converge(read, tolerance, threads_of(threads), tick))
    study = Summary(ending.table, ending.json, status=ending.status, message=ending.message, warnings=ending.warnings)
    if study.status == 130:
        raise Interrupted(study)
    return study


def solve(problem, conditions=None, output=None, *, overwrite=False, settings=None, threads=0, **overrides):
    """Solves a boundary-value problem and returns its Result; a Summary where no solution was found.

    Parameters
    ----------
    problem : path or str with [solve], or a Hamiltonian, Lagrangian or Lattice with `t_span`, `step` and other keywords
        of integrate(): the guess. Of a Lattice periodic orbits are found, with levels="fixed"
    conditions : dict
        Entries of [solve], in place of those of a file: ``{"ends": "periodic", "energy": 1/12}``.
    output : path, optional
        The record to write; in memory otherwise.
    settings, **overrides : as of run()

    `success` is True if there is a solution that is not lost, `figures["solution"]` how the search went, with
    `step_error`, its error by half the step, and `solution` of a Result what is known of it: residuals, Floquet
    multipliers, conjugate points, the Morse index.

    Examples
    --------
    >>> import numpy as np, rubato as rb
    >>> pendulum = rb.Hamiltonian("q", "p", lambda q, p: p**2/2 - np.cos(q))
    >>> r = rb.solve(pendulum, {"ends": "periodic", "energy": -0.5}, initial=[1, 0], t_span=(0, 6.7), step=0.1)
    >>> r.success
    True
    >>> bool(abs(r.t[-1] - 6.743001419250) < 1e-7)
    True
    """
    stated = [f"solve.{key}={_toml.value_text(value)}" for key, value in (conditions or {}).items()]
    read = _problem_of(problem, overrides, [*(settings or ()), *stated], "solve")
    with _Place(output) as place:
        ending = _core.solve(read, place, overwrite or output is None, threads_of(threads))
        if not ending.verdict:
            return _finish(Summary(ending.table, ending.json, status=ending.status, message=ending.message,
                                   warnings=ending.warnings))
        result = Result(_core.Reader(place), read, ending, file=place)
        return _finish(result if output is not None else result.in_memory())


def compare(a, b) -> Summary:
    """Compares two records: figures side by side, and the lines in which their problems differ."""
    files = [value.file if isinstance(value, Result) else path_of(value) for value in (a, b)]
    if None in files:
        raise ValueError("records are compared: give the run a file")
    figures, table = _core.compare(*files)
    return Summary(table, figures)


def catalogue() -> dict:
    """Returns the problems of the catalogue, name: title."""
    return {name: title for name, title, _ in _core.catalogue()}


def show(name: str) -> str:
    """Returns a problem of the catalogue as text, to start from."""
    return _core.show(name, [])


def help(topic: str = "problem") -> str:
    """Returns what `rubato help TOPIC` prints."""
    return _core.help_text(topic)
