"""Variational integration with variable time levels.

State a system, integrate it, look at its laws:

>>> import numpy as np, rubato as rb
>>> pendulum = rb.Hamiltonian("q", "p", lambda q, p: p**2/2 - np.cos(q))
>>> r = rb.integrate(pendulum, [0, 1.9], (0, 20), step=0.1)
>>> r.verdict
'good'
"""

import os as _os

_os.environ.setdefault("OMP_WAIT_POLICY", "passive")  # threads that wait leave the processor to others

from ._core import FileError, ProblemError, RecordError, RecordExists
from ._core import version as __version__
from ._ensemble import EnsembleResult
from ._events import Event
from ._result import Result, Summary
from ._run import (Interrupted, RubatoWarning, catalogue, check, compare, converge, help, integrate, open, resume, run,
                   scan, show, solve)
from ._steps import Integrator
from ._symbols import Symbol, csch, sech, symbols, where
from ._systems import Field, Hamiltonian, Lagrangian, Lattice, Multisymplectic

__all__ = [
    "EnsembleResult", "Event", "Field", "FileError", "Hamiltonian", "Integrator", "Interrupted", "Lagrangian",
    "Lattice", "Multisymplectic", "ProblemError", "RecordError", "RecordExists", "Result", "RubatoWarning", "Summary",
    "Symbol", "catalogue", "check", "compare", "converge", "csch", "help", "integrate", "open", "resume", "run", "scan",
    "sech", "show", "solve", "symbols", "where",
]


def __getattr__(name):
    from ._toml import suggestion

    raise AttributeError(f"module 'rubato' has no attribute {name!r}{suggestion(name, __all__)}")
