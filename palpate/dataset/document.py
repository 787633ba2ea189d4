"""The tables of docs/dataset.md, made from the contract and the checks.

python -m palpate.dataset.document docs/dataset.md      writes them anew, between their markers
"""

import argparse
import re
from pathlib import Path

from palpate.dataset.checks import CHECKS
from palpate.store.contract import CONTRACT, SYMBOLS


def contract_table() -> str:
    """Every array of every store."""
    rows = [
        f"| {stage} | `{name}` | {spec.axes} | {spec.dtype} | {spec.unit} | {spec.meaning}"
        f"{'; optional' if spec.optional else ''} |"
        for stage, store in CONTRACT.items()
        for name, spec in store.arrays.items()
    ]
    return "\n".join(["| store | array | shape | type | unit | meaning |", "|---|---|---|---|---|---|", *rows])


def symbol_table() -> str:
    """What the letters in shapes count."""
    rows = [f"| {symbol} | {meaning} |" for symbol, meaning in SYMBOLS.items()]
    return "\n".join(["| symbol | counts |", "|---|---|", *rows])


def check_table() -> str:
    """Every check of the validation."""
    rows = [f"| {name} | {check.measures} | {check.limit:.3g} |" for name, check in CHECKS.items()]
    return "\n".join(["| check | measures | limit |", "|---|---|---|", *rows])


TABLES = {"contract": contract_table, "symbols": symbol_table, "checks": check_table}


def renewed(text: str) -> str:
    """A document with its tables as they are now; raises ValueError if it lacks a table's markers."""
    for name, table in TABLES.items():
        pattern = rf"(<!-- {name} -->\n).*?(\n<!-- end -->)"
        text, found = re.subn(pattern, lambda match: match[1] + table() + match[2], text, flags=re.S)  # noqa: B023
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
