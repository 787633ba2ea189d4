"""The description of an export in Croissant 1.0, MLCommons' JSON-LD for search engines and loaders.

https://docs.mlcommons.org/croissant/docs/croissant-spec-1.0.html. It has all files, and the columns of the tables;
samples are read with the tools of their layout. Fields `rai:` are those of its extension for responsible AI,
https://docs.mlcommons.org/croissant/docs/croissant-rai-spec.html.
"""

import csv
import fnmatch
import json
import re
from collections import Counter
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import jinja2

from palpate import __version__
from palpate.checksums import Manifest
from palpate.dataset import Dataset
from palpate.interchange.items import CARD, versions

TEMPLATE = Path(__file__).with_name("croissant.json.jinja")
# Columns of the tables that are not text.
NUMBERS = ("sample", "grasp")
KEYS = {"objects.csv": "object", "grasps.csv": "sample"}


def write_croissant(
    path: Path, dataset: Dataset, splits: Iterable[str], manifest: Manifest, licence: str, source: str
) -> None:
    """Write the description of an export whose files are in `manifest`, without a date.

    splits: names. The other arguments are those of `export`.
    """
    found = [*filter(re.compile(r"[^/]+\.(csv|json|tar)").fullmatch, manifest)]
    files = [_file(name, manifest) for name in found]
    patterns = {
        "meshes": ("model/gltf-binary", "meshes/*.glb"),
        "metadata": ("application/x-parquet", "*/metadata.parquet"),
    }
    patterns |= {"images": ("image/png", "*/*/*/*.png")}
    patterns |= {split: ("application/vnd.zarr", f"{split}.zarr/**") for split in splits}
    files += [_set(name, *each) for name, each in patterns.items() if fnmatch.filter(manifest, each[1])]
    sets = [_records(path.parent / name, key) for name, key in KEYS.items() if name in manifest]
    counts = sorted(Counter(record.class_name for record in dataset).items())
    stated = {"dataset": dataset, "counts": counts, "licence": licence, "source": source, "version": __version__}
    template = jinja2.Template(TEMPLATE.read_text(encoding="utf-8"), undefined=jinja2.StrictUndefined)
    described = json.loads(template.render(**stated, card=CARD, versions=versions(dataset)))
    described |= {"distribution": files, "recordSet": sets}
    text = json.dumps(described, indent=1).replace("<", "\\u003c")  # ends no script element of a page that has it
    path.write_text(text + "\n", encoding="utf-8")


def _file(name: str, manifest: Manifest) -> dict[str, Any]:
    size, digest = manifest[name]
    encoding = {".csv": "text/csv", ".json": "application/json", ".tar": "application/x-tar"}[Path(name).suffix]
    stated = {"contentUrl": name, "contentSize": f"{size} B", "encodingFormat": encoding, "sha256": digest}
    return {"@type": "cr:FileObject", "@id": name, "name": name, **stated}


def _set(name: str, encoding: str, includes: str) -> dict[str, Any]:
    """A set of files of the export's folder."""
    stated = {"description": name, "encodingFormat": encoding, "includes": includes}
    return {"@type": "cr:FileSet", "@id": f"{name}-files", "name": name, **stated}


def _records(table: Path, key: str) -> dict[str, Any]:
    """The rows of a table as a record set."""
    with table.open(encoding="utf-8", newline="") as file:
        columns = next(csv.reader(file))
    fields = [
        {
            **{"@type": "cr:Field", "@id": f"{table.stem}/{name}", "name": name},
            "dataType": "sc:Integer" if name in NUMBERS else "sc:Text",
            "source": {"fileObject": {"@id": table.name}, "extract": {"column": name}},
        }
        for name in columns
    ]
    stated = {"key": {"@id": f"{table.stem}/{key}"}, "field": fields}
    return {"@type": "cr:RecordSet", "@id": table.stem, "name": table.stem, **stated}
