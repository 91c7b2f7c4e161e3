"""Draws comet.png and prints the table of README.md: a comet in fictitious time, by variable levels and by SciPy.

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


def energy(r, v):
    return v @ v / 2 - 1 / np.sqrt(r @ r)


class Run:
    """Times, states (x, y, u, v) in columns, and evaluations of the force."""

    def __init__(self, t, y, evaluations):
        self.t, self.y, self.evaluations = np.asarray(t), y, evaluations
        self.steps = len(self.t) - 1


def ours(revolutions):
    comet = rb.Hamiltonian("r[2]", "v[2]", energy, time_scale=lambda r, v: (r @ r) ** 0.75)
    run = rb.integrate(comet, START, (0, revolutions * FICTITIOUS_PERIOD), scheme="gauss", stages=4, step=0.4)
    return Run(run.t, run.y, 4 * run.figures["newton_iterations"]["mean"] * run.figures["steps"])


def scipy(revolutions, tolerance):
    """In the same fictitious time, with t as a fifth unknown."""
    def motion(s, z):
        squared = z[0] * z[0] + z[1] * z[1]
        scale, pull = squared**0.75, squared**-0.75
        return [scale * z[2], scale * z[3], -pull * z[0], -pull * z[1], scale]

    run = solve_ivp(motion, (0, revolutions * FICTITIOUS_PERIOD), [*START, 0], method="DOP853", rtol=tolerance,
                    atol=tolerance)
    return Run(run.y[4], run.y[:4], run.nfev)


def scipy_in_t(revolutions, tolerance):
    def motion(t, z):
        return [z[2], z[3], *(-z[:2] / np.hypot(z[0], z[1]) ** 3)]

    run = solve_ivp(motion, (0, revolutions * PERIOD), START, method="DOP853", rtol=tolerance, atol=tolerance)
    return Run(run.t, run.y, run.nfev)


def ellipse(anomaly):
    return np.cos(anomaly) - ECCENTRICITY, np.sqrt(1 - ECCENTRICITY**2) * np.sin(anomaly)


def position_errors(run):
    """Distances from Kepler's ellipse at the same times, by Newton's method for Kepler's equation."""
    mean = run.t
    anomaly = mean + ECCENTRICITY * np.sin(mean)
    for _ in range(100):
        anomaly -= (anomaly - ECCENTRICITY * np.sin(anomaly) - mean) / (1 - ECCENTRICITY * np.cos(anomaly))
    x, y = ellipse(anomaly)
    return np.hypot(run.y[0] - x, run.y[1] - y)


def table():
    lines = ["| | steps | evaluations of the force | error after 20 | error after 200 |", "|---|---|---|---|---|"]
    for name, solve in (("Rubato", ours),
                        ("`DOP853`, 1e-12", lambda n: scipy(n, 1e-12)),
                        ("`DOP853`, 1e-13", lambda n: scipy(n, 1e-13)),
                        ("`DOP853` without time scale, 1e-13", lambda n: scipy_in_t(n, 1e-13))):
        short, long = solve(20), solve(200)
        lines.append(f"| {name} | {short.steps / 20:.0f} | {short.evaluations / 20:,.0f} | "
                     f"{position_errors(short).max():.0e} | {position_errors(long).max():.0e} |")
    return "\n".join(lines)


def draw(file):
    revolutions = np.arange(1, 201)
    runs = (("DOP853, 1e-12", scipy(200, 1e-12), "C0"), ("DOP853, 1e-13", scipy(200, 1e-13), "C2"),
            ("Rubato", ours(200), "C1"))
    figure, (left, right) = plt.subplots(1, 2, figsize=(9, 3.4), layout="constrained")
    left.plot(*ellipse(np.linspace(0, 2 * np.pi, 400)), lw=0.5, color="C1")
    left.plot(runs[-1][1].y[0, :29], runs[-1][1].y[1, :29], "o", ms=3, color="C1")
    left.set(xlabel="x", ylabel="y", title="the steps of one revolution")
    for name, run, colour in runs:
        errors = position_errors(run)
        largest = [errors[run.t < PERIOD * n].max() for n in revolutions]
        right.loglog(revolutions, largest, color=colour, label=f"{name}: {run.steps / 200:.0f} steps a revolution")
    right.set(xlabel="revolutions", title="error of the position")
    right.legend()
    figure.savefig(file, dpi=100, metadata={"Software": None})


def main():
    folder = Path(sys.argv[1]) if len(sys.argv) > 1 else Path(__file__).parent
    print(table())
    draw(folder / "comet.png")


if __name__ == "__main__":
    main()
