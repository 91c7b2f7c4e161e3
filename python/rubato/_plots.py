"""Pictures, with matplotlib if it is installed."""

from __future__ import annotations

import base64
import html as _html
import io

import numpy as np

from . import _toml


def _figure(axes, **options):
    if axes is not None:
        return axes.figure, axes
    try:
        from matplotlib import pyplot
    except ImportError:
        raise ImportError("pictures need matplotlib: install it (Debian: python3-matplotlib)") from None
    return pyplot.subplots(**options)


def kinds(result) -> list:
    """The pictures that there are of a result, the first one first."""
    if result._problem.is_lattice:
        return ["map" if len(result._problem.axes) == 1 else "field", "energy", "steps", "laws"]
    return ["orbit", "energy", "steps"] + (["section"] if result._problem.events else [])


@_toml.suggesting
def plot(result, what=None, *, axes=None, name=None, x=None, y=None):
    """Draws a result and returns matplotlib's axes.

    Parameters
    ----------
    what : {"orbit", "energy", "steps", "section", "map", "field", "laws"}
        The first one that there is, unless given.
    axes : matplotlib axes, optional
    name : str, optional
        The field of a map, the event of a section.
    x, y : str, optional
        The columns of an orbit.
    """
    drawers = {"orbit": _orbit, "energy": _energy, "steps": _steps, "section": _section, "map": _map, "field": _field,
               "laws": _laws}
    what = what or kinds(result)[0]
    on_lattice = bool(result._problem.axes)
    if what not in drawers or (what in ("map", "field") and not on_lattice) or (what == "orbit" and on_lattice):
        raise ValueError(f"there is no picture {what!r}; of this result there are {', '.join(kinds(result))}")
    _, axes = _figure(axes)
    drawers[what](result, axes, name=name, x=x, y=y)
    return axes


def _orbit(result, axes, *, x=None, y=None, **_):
    names = result._problem.q + result._problem.p
    n = len(result._problem.q)
    x = x or names[0]
    y = y or names[1 if n > 1 else n]
    axes.plot(result[x], result[y], lw=0.8)
    axes.set(xlabel=x, ylabel=y, title=result.title)
    if n > 1 and x in result._problem.q and y in result._problem.q:
        axes.set_aspect("equal", adjustable="datalim")


def _energy(result, axes, **_):
    energy, t = result.energy, result._read("/levels/t")
    node = result._read("/levels/node_energy")
    axes.plot(t, node - node[0], lw=0.8, label="H at the levels")
    axes.plot(t[1:], energy - energy[0], lw=0.8, label="discrete energy")
    axes.set(xlabel="t", ylabel="change of the energy", title=result.title)
    axes.legend()


def _steps(result, axes, **_):
    t, h = result._read("/levels/t"), result.h
    off = np.asarray(result._read("/levels/off_law"), dtype=bool)
    axes.plot(t[1:], h, lw=0.8)
    if off.any():
        axes.plot(t[1:][off], h[off], "o", ms=3, label="off the law")
        axes.legend()
    axes.set(xlabel="t", ylabel="h", title=result.title)


def _section(result, axes, *, name=None, **_):
    crossings = result.events[name or next(iter(result.events))]
    if crossings.quantities is not None and crossings.quantities.shape[1] > 1:
        axes.plot(crossings.quantities[:, 0], crossings.quantities[:, 1], ".", ms=2)
    else:
        n = len(result._problem.q)
        axes.plot(crossings.y[n - 1], crossings.y[-1], ".", ms=2)
        axes.set(xlabel=result._problem.q[-1], ylabel=result._problem.p[-1])
    axes.set(title=f"{result.title}: {crossings.name}")


def _first_field(result, name):
    known = [field for field in result._problem.fields if field in result]
    return name or known[0]


def _map(result, axes, *, name=None, **_):
    name = _first_field(result, name)
    (axis, *_rest), = result._problem.axes
    rows = slice(None, None, max(1, len(result.t) // 500))
    values, t, x, shift = result[name][rows], result.t[rows], result[axis], result.shift(axis)
    if shift is None:
        image = axes.pcolormesh(x, t, values, shading="nearest", cmap="RdBu_r", rasterized=True)
    else:  # each row where its nodes are in the laboratory
        places = x[None, :] + shift[rows, None]
        image = axes.pcolormesh(places, np.broadcast_to(t[:, None], places.shape), values, shading="gouraud",
                                cmap="RdBu_r", rasterized=True)
    axes.set(xlabel=axis, ylabel="t", title=result.title)
    axes.figure.colorbar(image, ax=axes, label=name)


def _field(result, axes, *, name=None, **_):
    name = _first_field(result, name)
    values = result[name][-1]
    while values.ndim > 2:
        values = values[len(values) // 2]
    if values.ndim == 1:
        axes.plot(result[result._problem.axes[0][0]], values, lw=0.8)
        axes.set(xlabel=result._problem.axes[0][0], ylabel=name)
    else:
        x, y = (result[axis[0]] for axis in result._problem.axes[:2])
        image = axes.pcolormesh(x, y, values, shading="nearest", cmap="RdBu_r", rasterized=True)
        axes.figure.colorbar(image, ax=axes, label=name)
    axes.set_title(f"{result.title}, t = {result.t[-1]:.6g}")


def _laws(result, axes, **_):
    t = result._read("/levels/t")
    for name, values in result.laws.items():
        if name.endswith("_max") and values.ndim == 1 and len(values) == len(t) - 1:
            axes.semilogy(t[1:], np.maximum(np.abs(values), 1e-300), lw=0.8, label=name[:-4])
    axes.set(xlabel="t", ylabel="largest local residual", title=result.title)
    axes.legend()


def convergence(summary, axes=None):
    if "quantities" not in summary.figures:
        raise ValueError("a picture of errors is that of rubato.converge")
    _, axes = _figure(axes)
    steps = summary["step"] * np.array([1.0, 0.5, 0.25])
    for name, figures in summary["quantities"].items():
        error, order = figures["step"]["error"], figures["step"].get("order")
        errors = error * (steps / steps[0]) ** (order if order is not None else 0.0)
        axes.loglog(steps, errors, "o-", label=name if order is None else f"{name}, order {order:.2f}")
    axes.set(xlabel="step", ylabel=f"error at t = {summary['until']:.6g}")
    axes.legend()
    return axes


def html(result) -> str:
    """The table, the verdict and the first two pictures, for a notebook."""
    parts = []
    if result.verdict:
        colour = {"good": "#1a7f37", "doubtful": "#9a6700", "lost": "#cf222e"}.get(result.verdict, "#000")
        parts.append(f'<p><b style="color:{colour}">{_html.escape(result.verdict)}</b> '
                     f"{_html.escape(result.message)}</p>")
    if result.table:
        parts.append(f"<pre>{_html.escape(result.table)}</pre>")
    else:
        parts.append(f"<p>{_html.escape(repr(result))}</p>")
    try:
        from matplotlib.backends.backend_agg import FigureCanvasAgg
        from matplotlib.figure import Figure
    except ImportError:
        return "".join(parts)
    figure = Figure(figsize=(9, 3.5), layout="constrained")
    FigureCanvasAgg(figure)
    for axes, what in zip(figure.subplots(1, 2), kinds(result)):
        try:
            plot(result, what, axes=axes)
        except (KeyError, ValueError, IndexError):
            axes.set_axis_off()
    image = io.BytesIO()
    figure.savefig(image, format="png", dpi=90)
    parts.append(f'<img src="data:image/png;base64,{base64.b64encode(image.getvalue()).decode()}">')
    return "".join(parts)
