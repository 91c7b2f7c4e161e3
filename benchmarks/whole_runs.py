"""Whole runs as a user waits for them: `rubato run` and SciPy's solve_ivp (DOP853), for the same error of the energy.

    python3 benchmarks/whole_runs.py build/rubato

Prints the table of docs/performance-tables.md. Times are CPU seconds: of the program with its start and its record, and
of solve_ivp with a right-hand side in NumPy. Of each side the cheapest setting that reaches the error is reported.
"""

import json
import resource
import subprocess
import sys
import tempfile
import time

import numpy as np
from scipy.integrate import solve_ivp


def kepler(e=0.6):
    def field(t, z):
        r3 = (z[0] * z[0] + z[1] * z[1]) ** 1.5
        return [z[2], z[3], -z[0] / r3, -z[1] / r3]

    def energy(z):
        return (z[2] ** 2 + z[3] ** 2) / 2 - 1 / np.hypot(z[0], z[1])

    return field, energy, [1 - e, 0, 0, np.sqrt((1 + e) / (1 - e))]


def henon_heiles():
    def field(t, z):
        x, y, u, v = z
        return [u, v, -x - 2 * x * y, -y - x * x + y * y]

    def energy(z):
        x, y, u, v = z
        return (u * u + v * v + x * x + y * y) / 2 + x * x * y - y**3 / 3

    return field, energy, [0, 0.1, np.sqrt(2 / 12 - 0.01 + 0.002 / 3), 0]


def chain(count=31, alpha=0.25):
    def stretches(q):
        return np.diff(q, prepend=0, append=0, axis=0)

    def field(t, z):
        d = stretches(z[:count])
        force = d + alpha * d * d
        return np.concatenate((z[count:], force[1:] - force[:-1]))

    def energy(z):
        d = stretches(z[:count])
        return (z[count:] ** 2).sum(0) / 2 + (d * d / 2 + alpha * d**3 / 3).sum(0)

    start = np.sin(np.arange(1, count + 1) * np.pi / (count + 1))
    return field, energy, np.concatenate((start, np.zeros(count)))


# Name, catalogue entry, SciPy's side, end, schemes of Rubato, steps that are tried.
SPLITTING = ["scheme.lagrangian=splitting", "scheme.composition=blanes-moan-rkn-6"]
GAUSS = ["scheme.lagrangian=gauss", "scheme.stages=4"]
PROBLEMS = [
    ("Kepler, e = 0.6, 1000 revolutions", "kepler", kepler(), 2000 * np.pi, (SPLITTING, GAUSS), 2 * np.pi / 20),
    ("Hénon–Heiles, t = 10⁴", "henon-heiles", henon_heiles(), 1e4, (SPLITTING, GAUSS), 1.6),
    ("chain of 31 masses, t = 10⁴", "fput-chain", chain(), 1e4, (SPLITTING,), 1.6),
]


def by_scipy(side, end, error):
    field, energy, start = side
    for tolerance in 10.0 ** -np.arange(5, 14, 0.5):
        before = time.process_time()
        solution = solve_ivp(field, (0, end), start, "DOP853", rtol=tolerance, atol=1e-3 * tolerance)
        spent = time.process_time() - before
        levels = energy(solution.y)
        if np.abs(levels / levels[0] - 1).max() < error:
            return spent
    return float("nan")


def by_rubato(program, name, end, scheme, step, levels, error):
    with tempfile.TemporaryDirectory() as folder:
        for k in range(16):
            options = [*scheme, f"scheme.step={step / 2 ** (k / 2)}", f"scheme.until={end}", f"scheme.levels={levels}"]
            before = resource.getrusage(resource.RUSAGE_CHILDREN)
            run = subprocess.run(
                [program, "run", name, "--json", "--force", "-o", f"{folder}/run.h5", "--threads", "1"]
                + [word for option in options for word in ("--set", option)], capture_output=True, text=True)
            after = resource.getrusage(resource.RUSAGE_CHILDREN)
            spent = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
            if run.returncode in (0, 7):
                node = json.loads(run.stdout)["node_energy"]
                if node["max_deviation"] < error * abs(node["initial"]):
                    return spent
    return float("nan")


def main():
    program = sys.argv[1]
    print("| CPU seconds | error of H | SciPy | Rubato, equal steps | Rubato, variable levels |\n|---|---|---|---|---|")
    for name, entry, side, end, schemes, step in PROBLEMS:
        for error in (1e-6, 1e-9):
            ours = [min(by_rubato(program, entry, end, scheme, step, levels, error) for scheme in schemes)
                    for levels in ("fixed", "variable")]
            print(f"| {name} | {error:.0e} | {by_scipy(side, end, error):.2g} | {ours[0]:.2g} | {ours[1]:.2g} |", flush=True)


if __name__ == "__main__":
    main()
