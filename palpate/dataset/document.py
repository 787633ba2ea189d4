"""The tables of docs/dataset.md, made from the contract and the checks.

python -m palpate.dataset.document docs/dataset.md      writes them anew, between their markers
"""

import argparse
import re
from collections.abc import Iterable, Sequence
from pathlib import Path

from palpate.dataset.checks import CHECKS
from palpate.store.contract import CONTRACT, SYMBOLS


def tables() -> dict[str, str]:
    """By their markers: every array of every store, what the letters in shapes count, every check of the validation."""
    arrays = [
        (stage, f"`{name}`", spec.axes, spec.dtype, spec.unit, f"{spec.meaning}{'; optional' if spec.optional else ''}")
        for stage, store in CONTRACT.items()
        for name, spec in store.arrays.items()
    ]
    checks = [(name, check.measures, f"{check.limit:.3g}") for name, check in CHECKS.items()]
    return {
        "contract": _table(("store", "array", "shape", "type", "unit", "meaning"), arrays),
        "symbols": _table(("symbol", "counts"), SYMBOLS.items()),
        "checks": _table(("check", "measures", "limit"), checks),
    }


def _table(header: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    lines = (f"| {' | '.join(cells)} |" for cells in (header, *rows))
    return "\n".join([next(lines), "|---" * len(header) + "|", *lines])


def renewed(text: str) -> str:
    """A document with its tables as they are now; raises ValueError if it lacks a table's markers."""
    for name, table in tables().items():
        pattern = rf"(<!-- {name} -->\n).*?(\n<!-- end -->)"
        text, found = re.subn(pattern, lambda match: match[1] + table + match[2], text, flags=re.S)  # noqa: B023
        if found != 1:
            raise ValueError(f"expected one table between <!-- {name} --> and <!-- end -->, found {found}")
    return text


if __name__ == "__main__":
    parser = argparse.ArgumentParser(
        prog="python -m palpate.dataset.document", description=(__doc__ or "").splitlines()[0]
    )
    parser.add_argument("document", type=Path, help="docs/dataset.md")
    document = parser.parse_args().document
    document.write_text(renewed(document.read_text(encoding="utf-8")), encoding="utf-8")
