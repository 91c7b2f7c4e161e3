"""Runs that were reset on their way, as one result."""

from __future__ import annotations

import numpy as np

from ._result import Result, _Arrays


def join(parts: list, resets: list) -> Result:
    """Joins the runs between resets: each ends with the state of its crossing, and the next begins with the new one.

    Levels beyond a crossing are left out; `resets` of the result has (t, state before, state after) of each, and
    `energies` the discrete energy of each part.
    """
    names = list(parts[0].events)
    arrays = {"/states/t": [], "/states/q": [], "/states/p": [], "/levels/t": [], "/levels/node_energy": [],
              "/levels/h": [], "/levels/energy": [], "/levels/off_law": []}
    n = len(parts[0]._problem.q)
    for i, part in enumerate(parts):
        t = part._read("/states/t")
        keep = len(t)
        if i < len(resets):
            crossing, before, _ = resets[i]
            direction = 1.0 if t[-1] >= t[0] else -1.0
            keep = int(np.searchsorted(direction * t, direction * crossing, side="left"))
        for path in ("/states/t", "/states/q", "/states/p", "/levels/t", "/levels/node_energy"):
            arrays[path].append(part._read(path)[:keep])
        for path in ("/levels/h", "/levels/energy", "/levels/off_law"):
            arrays[path].append(part._read(path)[:keep])
        if i < len(resets):
            arrays["/states/t"].append(np.array([crossing]))
            arrays["/states/q"].append(before[None, :n])
            arrays["/states/p"].append(before[None, n:])
    datasets = [(path, ("t",), "", False) for path in arrays]
    joined = {path: np.concatenate(values) for path, values in arrays.items()}
    for name in names:
        for last in ("t", "direction", "q", "p"):
            path = f"/events/{name}/{last}"
            datasets.append((path, ("t",), "", False))
            joined[path] = np.concatenate([part._read(path) for part in parts])
    result = Result(_Arrays(datasets, joined), parts[0]._problem, names=names)
    last = parts[-1]
    result.status, result.message, result.table = last.status, last.message, last.table
    if resets:
        told = f"the state was reset {len(resets)} times, first at t = {resets[0][0]:.10g}: each part has a discrete " \
               "energy of its own"
        result.message = f"{last.message}; {told}" if last.message else told
    result.warnings = [sentence for part in parts for sentence in part.warnings]
    order = ["", "good", "doubtful", "lost"]
    result.verdict = max((part.verdict for part in parts), key=order.index)
    result._json = "{}"
    result.resets = resets
    result.parts = parts
    result.energies = np.array([part.energy[0] if len(part.energy) else np.nan for part in parts])
    return result
