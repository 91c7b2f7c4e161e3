"""Stepping by hand."""

from __future__ import annotations

import numpy as np

from . import _core, _toml
from ._events import as_events
from ._problem import build, numbers, real, threads_of
from ._systems import Lattice


class Integrator(_core.Stepper):
    """Steps a system: ``for step in Integrator(...)``.

    Parameters are those of integrate(), `events` too. Each step has `t`, `h`, `energy`, `events` (its crossings: `name`,
    `t`, `y`, `direction`, `quantities`) and, of an orbit, the state `y` (`q`, `p`) that it led to. In between the state
    may be read and assigned: ``integrator.y = ...``, ``integrator["x"] = ...``, of a lattice ``integrator["u"] = ...``.
    The run continues from a state that is assigned, at the same time and with the last step; it has a discrete energy of
    its own.

    An event with `terminal` ends the steps; `stopped` is its name. One with `reset` ends its step at the crossing, with
    the state there, and the next step begins from what ``reset(t, y)`` returned: `resets` has (t, state before, state
    after) of each.

    Examples
    --------
    >>> import rubato as rb
    >>> kepler = rb.Hamiltonian("x y", "u v", "(u^2 + v^2)/2 - 1/sqrt(x^2 + y^2)")
    >>> orbit = rb.Integrator(kepler, [1, 0, 0, 1], (0, 10), step=0.1, events={"up": rb.Event("y", direction=1)})
    >>> for step in orbit:
    ...     for crossing in step.events:
    ...         print(f"{crossing.name} at t = {crossing.t:.4f}")
    up at t = 6.2832
    >>> step.t > 9.999, len(step.y)
    (True, 4)
    """

    def __init__(self, system, initial=None, t_span=None, *, step=None, scheme=None, stages=None, levels=None,
                 events=None, settings=None, threads=0, **options):
        listed = as_events(events)
        refuse_resets(system, listed)
        self._system = system
        self._how = dict(step=step, scheme=scheme, stages=stages, levels=levels, events=listed, settings=settings,
                         options=options, function="Integrator")
        self._problem = build(system, initial, t_span, **self._how)
        self._names = self._problem.fields if self._problem.is_lattice else system.names
        self.resets = []
        super().__init__(self._problem, threads_of(threads), {event.name for event in listed if event.reset is not None})

    @property
    def y(self):
        """The state: coordinates, then momenta; of a Lagrangian coordinates, then velocities."""
        if self._problem.is_lattice:
            raise AttributeError  # with the words of __getattr__
        return self.state()

    @y.setter
    def y(self, state):
        if self._problem.is_lattice:
            raise AttributeError("a lattice has its fields by name: integrator[\"u\"]")
        self._restart(self._system, numbers(state, len(self._names), "y"), self.t)

    def __getitem__(self, name: str):
        if self._problem.is_lattice:
            return self.field(name)
        return float(self.state()[self._place(name)])

    def __setitem__(self, name: str, value):
        if not self._problem.is_lattice:
            state = self.state()
            state[self._place(name)] = value
            self.y = state
            return
        given = list(self._system._texts) + list(self._system._arrays)
        if name not in given:
            raise KeyError(f"{name!r} is not a field that the lattice was given; it was given {', '.join(given)}")
        fields = {other: self.field(other) for other in given}
        value = np.asarray(value, dtype=float)
        fields[name] = np.broadcast_to(value, self._system.shape)
        self._restart(Lattice(self._system.system, self._system._grid, fields, t=self.t), None, self.t)

    def _place(self, name: str) -> int:
        if name not in self._names:
            raise KeyError(f"{name!r}{_toml.suggestion(str(name), self._names)}")
        return self._names.index(name)

    def __getattr__(self, name: str):
        names = self.__dict__.get("_names", ())
        if name in names:
            return self[name]
        if name == "y":
            raise AttributeError(f"a lattice has its fields by name: integrator[\"{names[0]}\"]")
        known = [*names, *(word for word in dir(type(self)) if not word.startswith("_"))]
        raise AttributeError(f"an integrator has no {name!r}{_toml.suggestion(name, known)}")

    def __setattr__(self, name: str, value):
        if name.startswith("_") or hasattr(type(self), name) or name == "resets":
            super().__setattr__(name, value)
        elif name in self._names:
            self[name] = value
        else:
            raise AttributeError(f"an integrator has no {name!r}{_toml.suggestion(name, [*self._names, 'y'])}")

    def _restart(self, system, state, t: float):
        if self._problem.has_clock or self._problem.has_frame:
            raise ValueError(f"with {'time_scale' if self._problem.has_clock else 'a moving frame'} a state is not "
                             "assigned: begin another Integrator from it")
        if (self._problem.until - t) * self.h <= 0:
            raise ValueError(f"the run is at its end, t = {t:.10g}: begin another Integrator from there")
        step = self.h if self.steps else self._problem.step
        how = dict(self._how, step=step if step is not None else self._how["step"])
        problem = build(system, state, (t, self._problem.until), **how)
        self.restart(problem)
        self._problem, self._system = problem, system

    def _warn_of_missed(self, names: list):
        """Of events that left their zero and returned through it within the first step from a state, unseen."""
        from ._run import _warn

        _warn(f"event {name} starts at its zero and has returned through it within the first step, unseen: take a smaller "
              "step, or end the run there" for name in names)

    def _reset_at(self, step):
        """Goes on from the crossing that ended a step, with the state that its event returns."""
        crossing = step.events[-1]
        event = next(event for event in self._how["events"] if event.name == crossing.name)
        state = event.reset(crossing.t, crossing.y)
        if state is None:
            self.stop(crossing.name)
            return
        state = np.array(numbers(state, len(self._names), "what reset returns"))
        self.resets.append((crossing.t, crossing.y, state))
        if (self._problem.until - crossing.t) * self.h <= 0:
            self.stop(crossing.name)
        else:
            self._restart(self._system, state, crossing.t)

    def state_at(self, t: float):
        """Returns the state of an orbit at a time within the last step, by dense output."""
        return self.between(real(t, "t"))

    def __repr__(self) -> str:
        return f"<rubato.Integrator of {self._system!r} at t = {self.t:.10g}, {self.steps} steps>"


def refuse_resets(system, events: list):
    """Events on a lattice have no state to go on from, and of those with time_scale the time to go on from is another."""
    named = [event.name for event in events if event.reset is not None]
    if named and "time_scale" in getattr(system, "_tables", {}).get("hamiltonian", {}):
        raise ValueError(f"event {named[0]}: reset is not for systems with time_scale; end there with terminal=True and "
                         "integrate again from the state of the crossing")
    if named and isinstance(system, Lattice):
        raise ValueError(f"event {named[0]}: the state of a lattice at a crossing is not known, so that reset is for "
                         "orbits; step with rubato.Integrator and assign the fields: integrator[\"u\"] = ...")
