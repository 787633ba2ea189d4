"""The description of an export in Croissant 1.1, MLCommons' JSON-LD for search engines and loaders.

https://docs.mlcommons.org/croissant/docs/croissant-spec-1.1.html. It has all files, the columns of the tables, and type
and shape of each array. Loaders of Croissant read tables and images; for `.npy` and Zarr they have no reader. Fields
`rai:` are those of its extension for responsible AI,
https://docs.mlcommons.org/croissant/docs/croissant-rai-spec.html.
"""

import csv
import fnmatch
import json
import re
from collections import Counter
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import jinja2

from palpate import __version__
from palpate.checksums import Manifest
from palpate.dataset import Dataset, GraspDataset
from palpate.interchange.card import licence_url
from palpate.interchange.items import CARD, TEXT, Place, versions

TEMPLATE = Path(__file__).with_name("croissant.json.jinja")
# Columns of the tables that are not text.
NUMBERS = ("sample", "grasp")
KEYS = {"objects.csv": "object", "grasps.csv": "sample"}


def write_croissant(
    path: Path,
    dataset: Dataset,
    splits: Mapping[str, GraspDataset],
    places: Mapping[str, Place],
    manifest: Manifest,
    licence: str,
    source: str,
) -> None:
    """Write the description of an export whose files are in `manifest`, without a date; others as of `write_card`."""
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
    grasps, archives = next(iter(splits.values())), [name for name in found if name.endswith(".tar")]
    files, sets = map(list.__add__, (files, sets), _of_arrays(grasps, places, archives))
    counts = sorted(Counter(record.class_name for record in dataset).items())
    stated = {"dataset": dataset, "counts": counts, "source": source, "version": __version__}
    stated["licence"] = licence_url(licence) or licence
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


def _set(name: str, encoding: str, includes: str, archives: Sequence[str] = ()) -> dict[str, Any]:
    """A set of files of the export's folder, or of archives in it."""
    stated: dict[str, Any] = {"description": name, "encodingFormat": encoding, "includes": includes}
    if archives:
        stated["containedIn"] = [{"@id": each} for each in archives]
    return {"@type": "cr:FileSet", "@id": f"{name}-files", "name": name, **stated}


def _of_arrays(
    grasps: GraspDataset, places: Mapping[str, Place], archives: Sequence[str]
) -> tuple[list[dict[str, Any]], list[dict[str, Any]]]:
    """The sets of files, and of records, of arrays: one set of records for a table's columns, else one an array.

    archives: tar files that the arrays' files are in.
    """
    item, files, sets = grasps[0], [], []
    columns = [_field("grasps", name, "sc:Text", "metadata", column=name) for name in TEXT]
    columns += [_field("grasps", "grasp", "cr:Int64", "metadata", column="grasp")]
    for name, (_, spec) in grasps.sources.items():
        place, kind = places[name], item[name].dtype.name
        array = {"isArray": True, "arrayShape": ",".join(map(str, place.shape))} if place.shape else {}
        array["description"] = f"{spec.meaning}{spec.unit and f' ({spec.unit})'}"
        data_type = "sc:Boolean" if kind == "bool" else f"cr:{kind.title().replace('Ui', 'UI')}"
        if place.column:
            data_type = "sc:Text" if name in grasps.images else data_type
            columns.append(_field("grasps", place.column, data_type, "metadata", column=place.column) | array)
            continue
        encoding = "application/octet-stream" if archives else "application/vnd.zarr"
        if archives and name in grasps.images:  # a record is one image
            data_type, encoding, array = "sc:ImageObject", "image/png", {"description": array["description"]}
        files.append(_set(name, encoding, place.files, archives))
        fields = [_field(name, name, data_type, name, fileProperty="content") | array]
        if archives:
            fields.append(_field(name, "sample", "sc:Integer", name, fileProperty="filename"))
            fields[-1]["source"]["transform"] = {"regex": r"^(\d+)\..*$"}
        sets.append({"@type": "cr:RecordSet", "@id": name, "name": name, "field": fields})
    if not files:
        key = [{"@id": "grasps/object"}, {"@id": "grasps/grasp"}]
        sets.append({"@type": "cr:RecordSet", "@id": "grasps", "name": "grasps", "key": key, "field": columns})
    return files, sets


def _field(records: str, name: str, data_type: str, files: str, **extract: str) -> dict[str, Any]:
    """A field of a record set, from a set of files."""
    source = {"fileSet": {"@id": f"{files}-files"}, "extract": extract}
    field = {"@type": "cr:Field", "@id": f"{records}/{name}", "name": name}
    return field | {"dataType": data_type, "source": source}


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
