"""Stepping by hand."""

from __future__ import annotations

import numpy as np

from . import _core, _toml
from ._problem import build, numbers, real, threads_of
from ._systems import Lattice


class Integrator(_core.Stepper):
    """Steps a system: ``for step in Integrator(...)``.

    Parameters are those of integrate(). Each step has `t`, `h`, `energy` and, of an orbit, the state `y` (`q`, `p`)
    that it led to. In between the state may be read and assigned: ``integrator.y = ...``, of a lattice
    ``integrator["u"] = ...``. A state that was assigned is where the run goes on from, at the same time and with the
    last step, and its discrete energy is a new one.

    Examples
    --------
    >>> import rubato as rb
    >>> kepler = rb.Hamiltonian("x y", "u v", "(u^2 + v^2)/2 - 1/sqrt(x^2 + y^2)")
    >>> orbit = rb.Integrator(kepler, [1, 0, 0, 1], (0, 1), step=0.1)
    >>> for step in orbit:
    ...     pass
    >>> step.t > 0.999, len(step.y)
    (True, 4)
    """

    def __init__(self, system, initial=None, t_span=None, *, step=None, scheme=None, stages=None, levels=None,
                 settings=None, threads=0, **options):
        self._how = dict(step=step, scheme=scheme, stages=stages, levels=levels, settings=settings, options=options,
                         function="Integrator")
        self._system = system
        self._problem = build(system, initial, t_span, **self._how)
        super().__init__(self._problem, threads_of(threads))

    @property
    def y(self):
        """The state: coordinates, then momenta."""
        if self._problem.is_lattice:
            raise AttributeError("a lattice has its fields by name: integrator[\"u\"]")
        return self.state()

    @y.setter
    def y(self, state):
        if self._problem.is_lattice:
            raise AttributeError("a lattice has its fields by name: integrator[\"u\"]")
        if not self._problem.p or self._problem.q_dot:
            raise ValueError("the state of a Hamiltonian may be assigned, that of a Lagrangian not")
        self._restart(self._system, numbers(state, 2 * len(self._problem.q), "y"))

    def __getitem__(self, name: str):
        if self._problem.is_lattice:
            return self.field(name)
        names = self._problem.q + self._problem.p
        if name not in names:
            raise KeyError(f"{name!r}{_toml.suggestion(str(name), names)}")
        return float(self.state()[names.index(name)])

    def __setitem__(self, name: str, value):
        if not self._problem.is_lattice:
            names = self._problem.q + self._problem.p
            if name not in names:
                raise KeyError(f"{name!r}{_toml.suggestion(str(name), names)}")
            state = self.state()
            state[names.index(name)] = value
            self.y = state
            return
        given = list(self._system._texts) + list(self._system._arrays)
        if name not in given:
            raise KeyError(f"{name!r} is not a field that the lattice was given; it was given {', '.join(given)}")
        fields = {other: self.field(other) for other in given}
        value = np.asarray(value, dtype=float)
        fields[name] = np.broadcast_to(value, self._system.shape)
        self._restart(Lattice(self._system.system, self._system._grid, fields, t=self.t), None)

    def _restart(self, system, state):
        step = self.h if self.steps else self._problem.step
        how = dict(self._how, step=step if step is not None else self._how["step"])
        problem = build(system, state, (self.t, self._problem.until), **how)
        self.restart(problem)
        self._problem, self._system = problem, system

    def state_at(self, t: float):
        """Returns the state of an orbit at a time within the last step, by dense output."""
        return self.between(real(t, "t"))

    def __repr__(self) -> str:
        return f"<rubato.Integrator of {self._system!r} at t = {self.t:.10g}, {self.steps} steps>"
