"""Events: what is looked for along a run."""

from __future__ import annotations

import inspect

import numpy as np

from . import _symbols, _toml


class Event:
    """What is looked for along a run: where a formula passes zero, or a condition becomes true.

    Parameters
    ----------
    crossing : callable, str or SymPy expression
        ``lambda q, p: q``, or in scipy's form ``lambda t, y: y[0]``; or ``"x^2 + y^2 > 100"``.
    direction : {0, 1, -1}
        Both ways, upwards, downwards.
    terminal : bool or int
        Ends the run with the step of the first crossing, or of that number.
    reset : callable, optional
        Of an orbit: ``reset(t, y)`` returns the state to go on from, in the form of `initial`, or None to end there.
        The run continues from the crossing with a discrete energy of its own. A body that is back within a small part
        of a step falls through: the run warns, and its verdict is doubtful. Bounces that accumulate come to that; let
        `reset` return None below some speed.
    quantities : list, optional
        Formulas that are stored at each crossing.
    at : dict, optional
        On a lattice the point at which fields are meant: ``{"x": 3.5}``.
    """

    @_toml.suggesting
    def __init__(self, crossing, *, direction=0, terminal=False, reset=None, quantities=None, at=None, name=None):
        if direction not in (-1, 0, 1):
            raise ValueError(f"direction is 0, 1 or -1, and not {direction!r}")
        if reset is not None and not callable(reset):
            raise TypeError("reset is a function of t and y")
        self.crossing, self.direction, self.terminal, self.reset = crossing, direction, terminal, reset
        self.quantities, self.at, self.name = quantities, at, name

    def table(self, declared: list, others: list) -> dict:
        """Returns the event as a table of a problem file.

        Functions are called with the declared names of the state, vectors among them, and others that they name.
        """
        crossing = self.crossing
        if callable(crossing) and not isinstance(crossing, _symbols.Symbol):
            crossing = _scipy_form(crossing, [part for name in declared for part in _symbols.components(name)])
        table = {"crossing": _symbols.as_text(crossing, declared, others, f"event {self.name}")}
        if self.direction:
            table["direction"] = "up" if self.direction > 0 else "down"
        if self.terminal or self.reset is not None:
            table["stop"] = 1 if self.reset is not None or self.terminal is True else int(self.terminal)
        if self.quantities:
            table["quantities"] = [_symbols.as_text(q, declared, others, "quantity") for q in self.quantities]
        if self.at is not None:
            table["at"] = self.at
        return table


def _scipy_form(function, names: list):
    """``lambda t, y: y[0]`` as a symbol; other functions as they are."""
    parameters = list(inspect.signature(function).parameters)
    if len(parameters) == 2 and parameters[0] == "t" and parameters[1] not in names:
        state = np.empty(len(names), dtype=object)
        state[:] = _symbols.symbols(names)
        return _symbols.trace(lambda: function(_symbols.Symbol("t"), state), [], (), "event")
    return function


def as_events(events) -> list:
    """Returns what `events` of integrate() may be as a list of events with names of their own."""
    if events is None:
        return []
    if isinstance(events, dict):
        named = list(events.items())
    else:
        listed = events if isinstance(events, (list, tuple)) else [events]
        named = [(getattr(event, "name", None) or getattr(event, "__name__", "event"), event) for event in listed]
    result, taken = [], set()
    for name, event in named:
        name = name if isinstance(name, str) and name.isidentifier() else "event"
        number, unique = 1, name
        while unique in taken:
            number += 1
            unique = f"{name}_{number}"
        taken.add(unique)
        if not isinstance(event, Event):
            event = Event(event, direction=int(np.sign(getattr(event, "direction", 0))),
                          terminal=getattr(event, "terminal", False))
        result.append(Event(event.crossing, direction=event.direction, terminal=event.terminal, reset=event.reset,
                            quantities=event.quantities, at=event.at, name=unique))
    return result
