"""Apply faults to a copy of a run, and print who noticed.

    python -m studies.reliability results/smoke [--tries 20] [--seed 0] [--only checkpoint]

Prints the table of docs/evidence/reliability.md. Exits with 1 if anything was lost in silence.
"""

import argparse
import shutil
import sys
import tempfile
from pathlib import Path

import pandas as pd

from palpate.batch import generator
from palpate.results.tables import markdown
from studies.reliability.faults import COLUMNS, KINDS, each_damage, row


def main() -> None:
    """Print the table of faults of a run."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("run", type=Path)
    parser.add_argument("--tries", type=int, default=20, help="of each damage, on each kind of file")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--only", default="", help="kinds of files with this in their names")
    options = parser.parse_args()
    rows = []
    with tempfile.TemporaryDirectory() as folder:
        run = Path(folder) / "run"
        shutil.copytree(options.run, run, ignore=shutil.ignore_patterns(".snakemake"))
        for kind in KINDS:
            if options.only in kind.name:
                tries = each_damage(kind, run, generator(options.seed, kind.name), options.tries)
                rows.append(row(kind.name, tries, run))
                print(*rows[-1].values(), sep=" | ", file=sys.stderr, flush=True)
    table = pd.DataFrame(rows, columns=COLUMNS)
    print(markdown(table))
    sys.exit(int(table["lost in silence"].sum() > 0))


if __name__ == "__main__":
    main()
