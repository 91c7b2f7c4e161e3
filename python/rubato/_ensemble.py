"""Many orbits of one system, from an array of states."""

from __future__ import annotations

import numpy as np

from . import _core, _toml
from ._problem import build, threads_of
from ._result import Result
from ._symbols import vectors
from ._systems import Hamiltonian, without_mask

#: An orbit whose node energy strays by less, relative to its energy, is good without a further look at it.
_CLEARLY_GOOD = 1e-3

#: What a Result has and an ensemble has not.
_of_members = ("sol", "t_events", "y_events", "events", "laws", "reasons", "figures", "h", "H")


class EnsembleResult:
    """Many orbits of one system.

    Attributes
    ----------
    t, y : array
        The last levels, of shapes (members,) and (members, 2n). With `t_eval` the states at these times: t is `t_eval`,
        and y has the shape (members, 2n, len(t)). With `every` the stored levels, whose number may differ between
        members: t has the shape (members, most) and y the shape (members, 2n, most), with NaN after the last level of
        a member. A member that ended early has NaN at the times that it did not reach.
    last, t_last : array, shape (members, 2n) and (members,)
        The last levels, whatever `y` and `t` are.
    steps, energy, energy_deviation, node_energy_deviation, status : array, shape (members,)
        `status` is 0 for a member that reached its end; `messages` has the reasons of the others. After Ctrl-C it is
        130 for those that had not: they have the level that they had come to, or NaN.
    success, message : bool, str
        True if all members reached their end; how many did not, and why the first of them.
    verdicts, verdict, warnings : list of str, str, list of str
        The verdict of each member, the worst of these, and all warnings, gathered. One that was interrupted has none.

    Columns have their names: ``r["q"]`` and ``r.q`` are that part of `y`, of "q[2]" both components. With `t_eval`,
    `every` or `events`, ``r[5]`` is a member as a Result.

    Examples
    --------
    >>> import numpy as np, rubato as rb
    >>> pendulum = rb.Hamiltonian("q", "p", "p^2/2 - cos(q)")
    >>> states = np.column_stack([np.zeros(3), [0.5, 1.0, 1.5]])
    >>> many = rb.integrate(pendulum, states, (0, 10), step=0.1, t_eval=[0, 5, 10])
    >>> many.y.shape, many.verdict, many[2].t_events
    ((3, 2, 3), 'good', None)
    """

    def __init__(self, system, problem, states, threads: int, runs=None, *, numbers=None, stored: str = "",
                 event_names=()):
        self.names = list(system.names)
        self._runs, self._event_names = runs, list(event_names)
        self._again = (problem.text, self.names, states, threads)
        self._judgement = None
        if numbers is None:
            numbers = runs.results([], 0)
            self._judgement = {key: numbers.pop(key) for key in ("verdicts", "verdict", "warnings")}
        last, self.t_last = numbers.pop("y"), numbers.pop("t")
        halves = np.split(last, 2, axis=1)
        self.last = last if problem.pairs == len(problem.q) else np.hstack([half[:, :problem.pairs] for half in halves])
        self.__dict__.update(numbers)
        self.y, self.t = self.last, self.t_last
        if stored:
            self.t, self.y = self._stored()

    def _stored(self) -> tuple:
        """Times and states of all members, with NaN where there are none."""
        members = [self[m] if self.steps[m] or not self.status[m] else None for m in range(len(self))]
        most = max([len(r.t) for r in members if r is not None], default=0)
        times = np.full((len(members), most), np.nan)
        states = np.full((len(members), len(self.names), most), np.nan)
        for m, r in enumerate(members):
            if r is not None:
                times[m, :len(r.t)], states[m, :, :len(r.t)] = r.t, r.y
        return times, states

    @property
    def success(self) -> bool:
        return not self.status.any()

    @property
    def message(self) -> str:
        early = np.flatnonzero(self.status)
        return "" if not len(early) else (f"{len(early)} of {len(self)} members ended early; the first: "
                                          f"member {early[0]}: {self.messages[early[0]]}")

    @property
    def verdicts(self) -> list:
        return self._judged()["verdicts"]

    @property
    def verdict(self) -> str:
        return self._judged()["verdict"]

    @property
    def warnings(self) -> list:
        return self._judged()["warnings"]

    def _judged(self) -> dict:
        """Verdicts and warnings. Orbits that went side by side and do not clearly keep their energy are run alone."""
        if self._judgement is None:
            text, names, states, threads = self._again
            with np.errstate(invalid="ignore"):
                good = self.node_energy_deviation < _CLEARLY_GOOD * np.abs(self.energy)
            alone = np.flatnonzero(~(good & (self.status == 0)) & (self.status != 130))
            problem = _core.parse_problem(text, "rubato.integrate", ["output.every=1000000000"], {})
            runs = _core.ManyRuns(problem, names, states[alone], threads, None)
            numbers = runs.results(list(alone), len(states))
            self._judgement = {key: numbers[key] for key in ("verdict", "warnings")}
            self._judgement["verdicts"] = ["good" if status != 130 else "" for status in self.status]
            for m, verdict in zip(alone, numbers["verdicts"]):
                self._judgement["verdicts"][m] = verdict
        return self._judgement

    def __getitem__(self, which):
        if isinstance(which, str):
            parts = vectors(self.names).get(which)
            if parts:
                return self.y[:, [self.names.index(part) for part in parts]]
            if which not in self.names:
                raise KeyError(f"{which!r}{_toml.suggestion(which, self.names)}")
            return self.y[:, self.names.index(which)]
        if not isinstance(which, (int, np.integer)):
            raise TypeError(f"an ensemble has columns by name and members by number, and not {which!r}")
        if not -len(self) <= which < len(self):
            raise IndexError(f"there is no member {which} of {len(self)}")
        if self._runs is None:
            raise TypeError("members as results: give t_eval, every or events (a pickled ensemble has none)")
        number = int(which) % len(self)
        found = self._runs.member(number)
        if found is None:
            raise IndexError(f"member {number} was not run: the ensemble was interrupted")
        ending, rows = found
        return Result(_core.Memory(rows), self._runs.problem(number), ending, names=self._event_names)

    def __getattr__(self, name: str):
        names = self.__dict__.get("names", [])
        if name in names or name in vectors(names):
            return self[name]
        if name in _of_members:
            raise AttributeError(f"{name} belongs to each member: give t_eval, every or events, and take r[0].{name}")
        known = names + [word for word in [*dir(type(self)), *self.__dict__] if not word.startswith("_")]
        raise AttributeError(f"the ensemble has no {name!r}{_toml.suggestion(name, known)}")

    def __len__(self):
        return len(self.last)

    def __repr__(self):
        early = int((self.status != 0).sum())
        verdict = f", {self._judgement['verdict']}" if self._judgement is not None else ""
        return f"<rubato.EnsembleResult of {len(self)} members, {early} ended early{verdict}>"

    def __getstate__(self) -> dict:
        return {**self.__dict__, "_runs": None}


def integrate_many(system, initial, t_span, *, events, threads, tick, common) -> EnsembleResult:
    """Integrates from each of the states; `tick` is called with the number of those that are done."""
    states = np.asarray(without_mask(initial, "initial"))
    if states.dtype == object or states.dtype.kind not in "fiu":
        raise TypeError(f"initial takes real numbers, and not {states.dtype}")
    names = system.names
    if states.shape[1] != len(names):
        raise ValueError(f"initial has shape {states.shape}, and is to have ({len(names)},) or (members, {len(names)})")
    if states.shape[0] < 1 or not np.isfinite(states).all():
        raise ValueError("initial takes one finite state for each member")
    if any(event.reset is not None for event in events):
        raise ValueError("reset is for one orbit: leave it out, or integrate the members one by one")
    has_times = common["t_eval"] is not None or common["every"] is not None
    if common["quantities"] and not has_times:
        raise ValueError("quantities of an ensemble are those at t_eval, or at the levels of every: give one of these")
    states = np.array(states, dtype=float, order="C")
    threads = threads_of(threads)
    problem = build(system, states[0], t_span, events=events, **common)
    is_plain = isinstance(system, Hamiltonian) and len(problem.q + problem.p) == len(names)
    is_splitting = common["scheme"] == "splitting" and common["levels"] == "fixed"
    if is_plain and is_splitting and not (has_times or events):
        numbers = _core.ends(problem, states, threads, tick)
        return EnsembleResult(system, problem, states, threads, numbers=numbers)
    if not has_times:
        problem = build(system, states[0], t_span, events=events, **dict(common, every=1_000_000_000))
    runs = _core.ManyRuns(problem, names, states, threads, tick)
    result = EnsembleResult(system, problem, states, threads, runs, stored="/states/" if has_times else "",
                            event_names=[event.name for event in events])
    if common["t_eval"] is not None:
        result.t = np.array(common["t_eval"], dtype=float)
    if not (has_times or events):
        result._runs = None
    return result
