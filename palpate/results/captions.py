"""The captions of tables, figures and reports: `captions/<kind>.rst`, which Snakemake's own report reads too.

Each file is one template of Jinja, as `snakemake --report` asks for: it picks the text by the name of what it is for.
"""

import re
from functools import cache
from pathlib import Path

import jinja2

FOLDER = Path(__file__).with_name("captions")
KINDS = {"tables": "table", "figures": "figure", "reports": "report"}  # and the wildcard that a file's names are of


@cache
def _source(kind: str) -> str:
    return (FOLDER / f"{kind}.rst").read_text(encoding="utf-8")


def caption(kind: str, name: str) -> str:
    """The caption of a table, figure or report in one paragraph, with code between two backticks; empty for an unknown
    name. kind: of `KINDS`."""
    template = jinja2.Template(_source(kind))
    return " ".join(template.render(snakemake={"wildcards": {KINDS[kind]: name}}).split())


def position(kind: str, name: str) -> tuple[int, str]:
    """What sorts names in the order of their captions; those that share a caption by name, unknown ones at the end."""
    names = re.findall(rf'{KINDS[kind]}(?: == |\.startswith\()"([^"]+)"', _source(kind))
    return next((place for place, start in enumerate(names) if name.startswith(start)), len(names)), name
