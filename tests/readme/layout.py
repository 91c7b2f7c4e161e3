"""The tables of docs/records.md: every dataset of a record, by the description that the record itself holds.

    layout.py RUBATO PAGE            writes the tables into the page
    layout.py RUBATO PAGE --check    compares; status 1 where they differ

Runs have names of their own for fields, laws and the like; RULES replace them by what they stand for.
"""

import difflib
import re
import subprocess
import sys
import tempfile
from pathlib import Path

import h5py

BEGIN, END = "<!-- layout: written by tests/readme/layout.py -->", "<!-- end of layout -->"

ORBIT = """
[hamiltonian]
q = ["q"]
p = ["p"]
H = "p^2/2 - cos(q)"
[parameters]
k = 1
[initial]
q = 0
p = 1.9
[invariants]
NAME = "k*p"
[exact]
q = "t"
[events]
NAME = { crossing = "q", quantities = ["p"], stop = 9 }
[scheme]
step = 0.1
until = 0.5
tangents = { vectors = 2, matrix = true, parameters = ["k"] }
[output]
interval = 0.2
quantities = { NAME = "q" }
"""

#: The heading of a kind of records, and the runs that show its datasets; a dataset is listed where it comes first.
RUNS = [
    ("Every record, and orbits", [
        ["run", "orbit.toml"], ["run", "orbit.toml", "--set", "output.every=2"], ["run", "double-pendulum", "--set", "scheme.until=0.3"],
        ["run", "kepler", "--set", "scheme.until=0.5", "--set", "hamiltonian.time_scale=1 + x^2", "--set", "scheme.step=0.1"],
        ["run", "orbit.toml", "--unset", "output.interval"], ["run", "spherical-pendulum", "--set", "scheme.until=1"]]),
    ("Lattices", [
        ["run", "sine-gordon", "--tangents", "--set", "scheme.until=0.3", "--set", "laws.fields=true", "--set", "laws.every=2",
         "--set", "output.interval=0.2"],
        ["run", "sine-gordon", "--set", "scheme.until=0.3", "--set", "output.every=2"],
        ["run", "nls", "--set", "scheme.lagrangian=fourier", "--set", "scheme.until=0.02", "--set", "scheme.frame.velocity=1",
         "--set", "scheme.frame.phase.charge=0.5"],
        ["run", "kdv", "--set", "scheme.until=0.02", "--set", "scheme.step=0.01"],
        ["run", "sine-gordon-kink", "--set", "scheme.lagrangian=fourier", "--set", "scheme.until=0.1",
         "--set", "scheme.frame.velocity=c"],
        ["run", "sine-gordon-2d", "--set", "grid.x.cells=15", "--set", "grid.y.cells=15", "--set", "scheme.until=0.2"]]),
    ("Ensembles", [["scan", "pendulum", "initial.p=0.5:1:3", "--set", "scheme.until=1", "--set", "output.interval=0.5"],
                   ["scan", "orbit.toml", "initial.p=0.5:1:2"]]),
    ("Boundary-value problems", [["solve", "examples/lyapunov-orbit.toml"], ["solve", "examples/bratu.toml"],
                                 ["solve", "examples/pendulum-to-a-place.toml", "--set", 'solve.ends=["p_0 = 0", "2*p_0 = 0"]']]),
]

RULES = [
    (r"^(/states/|/states/previous/|/output/)(u|v|w|phi|p1|q1|psi_[rei]|[pqrsab])$", r"\1FIELD", r"\b(u|v|w|phi|p|q)\b", "FIELD"),
    (r"^/states/midpoints/\w+$", "/states/midpoints/FIELD", r"\bfield \w+", "field FIELD"),
    (r"^/exact/\w+$", "/exact/NAME", None, None),
    (r"^/laws/\w+_(max|rms|undefined)$", r"/laws/LAW_\1", None, None),
    (r"^/laws/(fields|totals)/\w+$", r"/laws/\1/LAW", r"\bof \w+ (over|at)", r"of LAW \1"),
    (r"^/laws/constraints/\w+_(max|rms|undefined)$", r"/laws/constraints/NAME_\1", None, None),
    (r"^/laws/[a-z]\w+$", "/laws/NAME", r"invariant \w+", "invariant NAME"),
    (r"^/tangents/growth_\d$", "/tangents/growth_I", r"vector \d", "vector I"),
    (r"^/members/values/.*$", "/members/values/PATH", r".*", "value of PATH in the member"),
    (r"^/grid/[yz](.*)$", r"/grid/x\1", None, None),
    (r"^/checkpoint/.*$", "", None, None),
    (r"^/frame/(row|column)$", r"/frame/\1", None, None),
    (r"^/frame/jump/\w+$", "/frame/jump/FIELD", None, None),
]
ORBITS = {"/states/q", "/states/p", "/states/previous/q", "/states/previous/p", "/output/q", "/output/p"}
#: Scales are linked into every group that needs them; they are listed where they come first here.
HOMES = ["levels", "grid", "states", "output", "events", "tangents", "frame", "members", "laws", "exact"]


def datasets(file):
    """Path, axes and description of every dataset, each once."""
    seen = set()

    def home(path):
        group = path.split("/")[1]
        return HOMES.index(group) if group in HOMES else len(HOMES), path.count("/"), path

    for path in sorted(file.attrs["contents"].splitlines(), key=home):
        if path not in file or h5py.h5o.get_info(file[path].id).addr in seen:
            continue
        seen.add(h5py.h5o.get_info(file[path].id).addr)
        dataset = file[path]
        axes = [dimension.label for dimension in dataset.dims if dimension.label]
        yield path, axes, dataset.attrs.get("description", "")


def tables(program):
    lines, listed = [], set()
    with tempfile.TemporaryDirectory() as folder:
        Path(folder, "orbit.toml").write_text(ORBIT)
        Path(folder, "examples").symlink_to(Path(__file__).resolve().parents[2] / "examples")
        for heading, runs in RUNS:
            rows = []
            for run in runs:
                done = subprocess.run([program, *run, "-o", "run.h5", "--force", "--quiet"], cwd=folder, capture_output=True, text=True)
                if done.returncode not in (0, 7):
                    sys.exit(f"status {done.returncode} of {' '.join(run)}\n{done.stderr}")
                with h5py.File(Path(folder, "run.h5")) as file:
                    is_orbit = "states/coordinate" in file or "members" in file
                    for path, axes, description in datasets(file):
                        is_figure = description.startswith("figure of the member")
                        if is_figure:
                            path = "/members/FIGURE"
                        elif not (is_orbit and path in ORBITS):
                            for pattern, name, words, meaning in RULES:
                                if re.match(pattern, path):
                                    path = re.sub(pattern, name, path)
                                    description = re.sub(words, meaning, description, count=1) if words else description
                                    break
                        if path and path not in listed:
                            listed.add(path)
                            rows.append(f"| `{path}` | {', '.join(axes)} | {description.replace('|', chr(92) + '|')} |")
            lines += [f"### {heading}", "", "| dataset | axes | contents |", "|---|---|---|", *sorted(rows), ""]
    return lines


def main():
    program, page = str(Path(sys.argv[1]).resolve()), Path(sys.argv[2])
    text = page.read_text(encoding="utf-8").splitlines()
    begin, end = text.index(BEGIN), text.index(END)
    new = text[: begin + 1] + ["", *tables(program)] + text[end:]
    if "--check" in sys.argv:
        difference = list(difflib.unified_diff(text, new, str(page), "the records", lineterm=""))
        print("\n".join(difference) or "every dataset is on the page")
        sys.exit(1 if difference else 0)
    page.write_text("\n".join(new) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
