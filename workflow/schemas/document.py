"""The tables of the documentation that are made of what the code reads.

python workflow/schemas/document.py      writes them anew, between their markers

config/README.md      the config's keys: of the schema's descriptions and the defaults of config/config.yaml
docs/dataset.md       every array of every store, what the letters in shapes count, every check of the validation
"""

import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import yaml

from palpate.dataset.checks import CHECKS
from palpate.store.contract import CONTRACT, SYMBOLS

PROJECT = Path(__file__).parents[2]
LONGEST_DEFAULT = 40  # characters


def rows(schema: Mapping[str, Any], default: Any, path: str = "") -> Iterator[tuple[str, str, str]]:
    """A row for each key with a description, in the schema's order: its path, its default, what it means."""
    if path and "description" in schema:
        text = yaml.safe_dump(default, default_flow_style=True, width=1000).removesuffix("\n").removesuffix("\n...")
        yield f"`{path}`", f"`{text}`" if len(text) <= LONGEST_DEFAULT else "", schema["description"]
    if isinstance(default, Mapping):
        for key, below in schema.get("properties", {}).items():
            yield from rows(below, default.get(key), f"{path}.{key}" if path else key)


def config_tables() -> dict[str, str]:
    """The table of config/README.md, by its marker."""
    schema = yaml.safe_load((PROJECT / "workflow/schemas/config.schema.yaml").read_text(encoding="utf-8"))
    default = yaml.safe_load((PROJECT / "config/config.yaml").read_text(encoding="utf-8"))
    return {"keys": _table(("key", "default", "meaning"), rows(schema, default))}


def dataset_tables() -> dict[str, str]:
    """The tables of docs/dataset.md, by their markers."""
    arrays, stages = [], {}
    for stage, store in CONTRACT.items():
        for name, spec in store.arrays.items():
            if name != "object":  # every store has it: the page says so once
                first = stages.setdefault((name, spec.meaning), stage)
                meaning = spec.meaning if first == stage else f"As in {first}"
                optional = "; optional" if spec.optional else ""
                arrays.append((stage, f"`{name}`", spec.axes, spec.dtype, spec.unit, meaning + optional))
    specs = [spec for store in CONTRACT.values() for spec in store.arrays.values()]
    axes = dict.fromkeys(axis for spec in specs for axis in zip(spec.shape, spec.dimensions, strict=True))
    names = {symbol: ", ".join(name for length, name in axes if length == symbol) for symbol in SYMBOLS}
    symbols = [(symbol, names[symbol], counts) for symbol, counts in SYMBOLS.items()]
    checks = [(name, check.measures, f"{check.limit:.3g}") for name, check in CHECKS.items()]
    return {
        "contract": _table(("store", "array", "shape", "type", "unit", "meaning"), arrays),
        "symbols": _table(("symbol", "dimension", "counts"), symbols),
        "checks": _table(("check", "measures", "limit"), checks),
    }


def _table(header: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    lines = (f"| {' | '.join(cells)} |" for cells in (header, *rows))
    return "\n".join([next(lines), "|---" * len(header) + "|", *lines])


DOCUMENTS = {"config/README.md": config_tables, "docs/dataset.md": dataset_tables}


def renewed(document: str) -> str:
    """A document, by its path in the project, with its tables as they are now. Raises ValueError without markers."""
    text = (PROJECT / document).read_text(encoding="utf-8")
    for name, table in DOCUMENTS[document]().items():
        pattern = rf"(<!-- {name} -->\n).*?(\n<!-- end -->)"
        text, tables = re.subn(pattern, lambda match: match[1] + table + match[2], text, flags=re.S)  # noqa: B023
        if tables != 1:
            raise ValueError(f"{document}: expected one table between <!-- {name} --> and <!-- end -->, found {tables}")
    return text


if __name__ == "__main__":
    for document in DOCUMENTS:
        (PROJECT / document).write_text(renewed(document), encoding="utf-8")
