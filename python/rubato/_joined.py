"""Runs that were reset on their way, as one result."""

from __future__ import annotations

import json

import numpy as np

from ._result import Result, _Arrays


def join(parts: list, resets: list, reset_by: list) -> Result:
    """Joins the runs between resets: each ends with the state of its crossing, and the next begins with the new one.

    Levels and crossings beyond a reset are left out. `resets` of the result has (t, state before, state after) of each,
    and `energies` the discrete energy of each part. `reset_by` names the event of each.
    """
    last = parts[-1]
    paths = [path for path in ("/states/t", "/states/q", "/states/p", "/states/q_dot") if path in last.paths]
    levels, steps = ["/levels/t", "/levels/node_energy"], ["/levels/h", "/levels/energy", "/levels/off_law"]
    crossings = [f"/events/{name}/{column}" for name in last.events for column in ("t", "direction", "q", "p")]
    arrays = {path: [] for path in paths + levels + steps + crossings}
    for i, part in enumerate(parts):
        t = part._read("/states/t")
        direction = 1.0 if t[-1] >= t[0] else -1.0
        end = resets[i][0] if i < len(resets) else None
        keep = len(t) if end is None else int(np.searchsorted(direction * t, direction * end, side="left"))
        for path in paths + levels + steps:
            arrays[path].append(part._read(path)[:keep])
        for path in crossings:
            found = part._read(path.rpartition("/")[0] + "/t")
            arrays[path].append(part._read(path)[slice(None) if end is None else direction * found <= direction * end])
        if end is not None:
            arrays["/states/t"].append(np.array([end]))
            for column in "qp":
                arrays[f"/states/{column}"].append(part._read(f"/events/{reset_by[i]}/{column}")[:1])
            if "/states/q_dot" in arrays:
                before = resets[i][1]
                arrays["/states/q_dot"].append(before[None, len(before) // 2:])
    joined = {path: np.concatenate(values) for path, values in arrays.items()}
    result = Result(_Arrays([(path, ("t",), "", False) for path in joined], joined), parts[0]._problem,
                    names=list(last.events))
    result.status, result.message, result.table = last.status, last.message, last.table
    if resets:
        said = f"the state was reset {len(resets)} times, first at t = {resets[0][0]:.10g}: each part has a discrete " \
               "energy of its own"
        result.message = f"{last.message}; {said}" if last.message else said
    reasons = [reason for part in parts for reason in part.figures.get("reasons", ())]
    result.warnings = [sentence for part in parts for sentence in part.warnings]
    result.warnings += [f"{reason['finding']}; {reason['remedy']}" for reason in reasons if reason["what"] == "event"]
    order = ["", "good", "doubtful", "lost"]
    result.verdict = max((part.verdict for part in parts), key=order.index)
    result._json = json.dumps({"verdict": result.verdict, "reasons": reasons})
    result.resets = resets
    result.parts = parts
    result.energies = np.array([part.energy[0] if len(part.energy) else np.nan for part in parts])
    return result
