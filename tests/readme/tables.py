"""The tables of measurements that a page states, against runs: tables.py RUBATO PAGE.

A comment before a table says how each of its numbers is found:

    <!-- table
    run: run sine-gordon --set scheme.until=12
    row: --set scheme.step=0.4
    column: --set scheme.stages=2: error.u.max
    -->

One `row` for each row, one `column` for each column but the first: options that are added, then a formula of the entries of `--json`. A number
on the page may differ by one in its last digit; rounding errors, below 1e-12, are not compared. Three times each number must not pass.
"""

import json
import math
import re
import shlex
import subprocess
import sys
import tempfile
from pathlib import Path

SOURCES = Path(__file__).resolve().parents[2]
ROUNDING = 1e-12


class Entry(dict):
    """An entry of the JSON, whose parts are attributes."""

    def __getattr__(self, name):
        return self[name]


def specified(comment):
    parts = {"run": [], "row": [], "column": []}
    for line in comment.strip().splitlines():
        key, _, rest = line.strip().partition(":")
        parts[key].append(rest.strip())
    return parts["run"][0], parts["row"], parts["column"]


def last_digit(text):
    """The unit of the last digit of a number such as 0.46 or 5.8e-3."""
    digits, _, exponent = text.partition("e")
    return 10.0 ** (int(exponent or 0) - len(digits.partition(".")[2]))


def agree(found, stated, text):
    return abs(found - stated) < 1.001 * last_digit(text) or max(found, stated) < ROUNDING


def check(program, page):
    wrong, checked, results = [], 0, {}
    text = page.read_text(encoding="utf-8")
    with tempfile.TemporaryDirectory() as folder:
        Path(folder, "examples").symlink_to(SOURCES / "examples")
        for comment, table in re.findall(r"<!-- table\n(.*?)-->\s*((?:\|[^\n]*\n)+)", text, re.S):
            run, rows, columns = specified(comment)
            cells = [[cell.strip() for cell in line.strip("|").split("|")] for line in table.splitlines()[2:]]
            if len(cells) != len(rows) or any(len(row) != len(columns) + 1 for row in cells):
                sys.exit(f"{page}: a table has other rows or columns than its comment:\n{table}")
            for row, numbers in zip(rows, cells):
                for column, number in zip(columns, numbers[1:]):
                    options, _, formula = column.rpartition(":")
                    command = tuple(shlex.split(f"{run} {row} {options} --force --json -o run.h5"))
                    if command not in results:
                        done = subprocess.run([program, *command], cwd=folder, capture_output=True, text=True)
                        if done.returncode not in (0, 7):
                            sys.exit(f"status {done.returncode} of {' '.join(command)}\n{done.stderr}")
                        results[command] = json.loads(done.stdout, object_hook=Entry)
                    found = eval(formula, {"pi": math.pi}, results[command])
                    checked += 1
                    if not agree(found, float(number), number):
                        wrong.append(f"{page.name}: {number} on the page, {found:.3g} by {' '.join(command)}")
                    if found > ROUNDING and agree(found, 3 * float(number), number):
                        wrong.append(f"{page.name}: {number} is too coarse for a comparison")
    return checked, wrong


def main():
    checked, wrong = check(str(Path(sys.argv[1]).resolve()), Path(sys.argv[2]))
    print("\n".join(wrong) or f"{checked} numbers are those of the runs")
    sys.exit(1 if wrong or not checked else 0)


if __name__ == "__main__":
    main()
