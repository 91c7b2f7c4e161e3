"""Draws comet.png and prints the table of README.md: a comet by a time scale and variable levels, and by SciPy.

    PYTHONPATH=build/python python3 docs/figures/comet.py [FOLDER]

FOLDER is where comet.png goes; the default is the folder of this script.
"""

import sys
from pathlib import Path

import matplotlib

matplotlib.use("Agg")
import matplotlib.pyplot as plt
import numpy as np
import rubato as rb
from scipy.integrate import solve_ivp

ECCENTRICITY = 0.99
PERIOD = 2 * np.pi
START = [1 - ECCENTRICITY, 0, 0, np.sqrt((1 + ECCENTRICITY) / (1 - ECCENTRICITY))]
FICTITIOUS_PERIOD = 11.4  # with dt = r^(3/2) ds
STEPS_DRAWN = 57  # of one revolution


def energy(r, v):
    return v @ v / 2 - 1 / np.sqrt(r @ r)


def fictitious(revolutions):
    comet = rb.Hamiltonian("r[2]", "v[2]", energy, time_scale=lambda r, v: (r @ r) ** 0.75)
    return rb.integrate(comet, START, (0, revolutions * FICTITIOUS_PERIOD), scheme="gauss", stages=3, step=0.2)


def scipy_steps(revolutions, tolerance=1e-9):
    def motion(t, z):
        return [z[2], z[3], *(-z[:2] / np.hypot(z[0], z[1]) ** 3)]

    return solve_ivp(motion, (0, revolutions * PERIOD), START, method="DOP853", rtol=tolerance, atol=tolerance)


def position_error(run):
    """The largest distance from Kepler's ellipse at the same times, by Newton's method for Kepler's equation."""
    mean = np.asarray(run.t)
    anomaly = mean + ECCENTRICITY * np.sin(mean)
    for _ in range(100):
        anomaly -= (anomaly - ECCENTRICITY * np.sin(anomaly) - mean) / (1 - ECCENTRICITY * np.cos(anomaly))
    x, y = np.cos(anomaly) - ECCENTRICITY, np.sqrt(1 - ECCENTRICITY**2) * np.sin(anomaly)
    return np.hypot(run.y[0] - x, run.y[1] - y).max()


def evaluations(run):
    """Of the force: those of SciPy, or one for each stage and iteration of Gauss collocation with three stages."""
    if hasattr(run, "nfev"):
        return run.nfev
    return 3 * run.figures["newton_iterations"]["mean"] * (len(run.t) - 1)


def table():
    lines = ["| | steps | evaluations of the force | error after 20 | error after 200 |", "|---|---|---|---|---|"]
    for name, solve in (("Rubato", fictitious),
                        ("SciPy `DOP853`, 1e-9", scipy_steps),
                        ("SciPy `DOP853`, 1e-12", lambda n: scipy_steps(n, 1e-12)),
                        ("SciPy `DOP853`, 1e-13", lambda n: scipy_steps(n, 1e-13))):
        short, long = solve(20), solve(200)
        lines.append(f"| {name} | {(len(short.t) - 1) / 20:.0f} | {evaluations(short) / 20:,.0f} | "
                     f"{position_error(short):.0e} | {position_error(long):.0e} |")
    return "\n".join(lines)


def draw(file):
    ours, theirs = fictitious(200), scipy_steps(200)
    figure, (left, right) = plt.subplots(1, 2, figsize=(9, 3.4), layout="constrained")
    left.plot(ours.y[0, :STEPS_DRAWN], ours.y[1, :STEPS_DRAWN], ".-", lw=0.5, color="C1")
    left.set(xlabel="x", ylabel="y", title=f"{STEPS_DRAWN} steps of one revolution")
    for name, run, colour in (("SciPy DOP853, 1e-9", theirs, "C0"), ("Rubato, variable levels", ours, "C1")):
        deviation = abs((run.y[2] ** 2 + run.y[3] ** 2) / 2 - 1 / np.hypot(run.y[0], run.y[1]) + 0.5)
        right.semilogy(np.asarray(run.t) / PERIOD, deviation, ".", ms=1, color=colour,
                       label=f"{name}: {len(run.t) - 1:,} steps")
    right.set(xlabel="revolutions", title="error of the energy H", ylim=(1e-13, 1e-4))
    right.legend(markerscale=8, loc="lower right")
    figure.savefig(file, dpi=100, metadata={"Software": None})


def main():
    folder = Path(sys.argv[1]) if len(sys.argv) > 1 else Path(__file__).parent
    print(table())
    draw(folder / "comet.png")


if __name__ == "__main__":
    main()
