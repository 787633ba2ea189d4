"""The table of keys in config/README.md, made from the schema's descriptions and the defaults of config/config.yaml.

python workflow/schemas/document.py      writes it anew, between its markers
"""

import re
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import yaml

PROJECT = Path(__file__).parents[2]
DOCUMENT = PROJECT / "config/README.md"
LONGEST_DEFAULT = 40  # characters


def rows(schema: Mapping[str, Any], default: Any, path: str = "") -> Iterator[str]:
    """A row for each key with a description, in the schema's order: its path, its default, what it means."""
    if path and "description" in schema:
        text = yaml.safe_dump(default, default_flow_style=True, width=1000).removesuffix("\n").removesuffix("\n...")
        shown = f"`{text}`" if len(text) <= LONGEST_DEFAULT else ""
        yield f"| `{path}` | {shown} | {schema['description']} |"
    if isinstance(default, Mapping):
        for key, below in schema.get("properties", {}).items():
            yield from rows(below, default.get(key), f"{path}.{key}" if path else key)


def renewed(text: str) -> str:
    """The document with its table as it is now. Raises ValueError if it lacks the table's markers."""
    schema = yaml.safe_load((PROJECT / "workflow/schemas/config.schema.yaml").read_text(encoding="utf-8"))
    default = yaml.safe_load((PROJECT / "config/config.yaml").read_text(encoding="utf-8"))
    table = "\n".join(["| key | default | meaning |", "|---|---|---|", *rows(schema, default)])
    text, found = re.subn(r"(<!-- keys -->\n).*?(\n<!-- end -->)", lambda m: m[1] + table + m[2], text, flags=re.S)
    if found != 1:
        raise ValueError(f"expected one table between <!-- keys --> and <!-- end -->, found {found}")
    return text


if __name__ == "__main__":
    DOCUMENT.write_text(renewed(DOCUMENT.read_text(encoding="utf-8")), encoding="utf-8")
