"""The description of an export in Croissant 1.1, MLCommons' JSON-LD for search engines and loaders: all files, the
columns of the tables, and type and shape of each array. Loaders read tables and images, but neither `.npy` nor Zarr.

https://docs.mlcommons.org/croissant/docs/croissant-spec-1.1.html; `rai:`: croissant-rai-spec.html beside it.
"""

import csv
import fnmatch
import json
from collections import Counter
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import jinja2

from palpate import __version__
from palpate.interchange.card import licence_url
from palpate.interchange.layouts import CARD, TEXT, Contents, pictures, versions
from palpate.seal import Files

TEMPLATE = Path(__file__).with_name("croissant.json.jinja")
# Media types: of the files at the top of the folder by suffix, and, with their pattern, of sets of files by name.
FILES = {".csv": "text/csv", ".json": "application/json", ".tar": "application/x-tar"}
SETS = {
    "meshes": ("model/gltf-binary", "meshes/*.glb"),
    "metadata": ("application/x-parquet", "*/metadata.parquet"),
    "images": ("image/png", "*/*/*/*.png"),
    "groups": ("application/vnd.zarr", "*.zarr/**"),
}
# By layout: media type and pattern of an array's files, unless it is a column; type of an image, unless it is an array.
LAYOUTS = {
    "webdataset": ("application/octet-stream", "*.{}.*", "sc:ImageObject"),
    "parquet": ("", "", "sc:Text"),
    "zarr": ("application/vnd.zarr", "*.zarr/{}/**", ""),
}
KEYS = {"objects.csv": "object", "grasps.csv": "sample", "presses.csv": "sample"}


def write_croissant(path: Path, contents: Contents, manifest: Files) -> None:
    """Write the description of an export whose files are in `manifest`, without a date."""
    top = [name for name in manifest if "/" not in name and Path(name).suffix in FILES]
    files: list[dict[str, Any]] = []
    for name in top:
        size, digest = manifest[name]
        about = {"contentUrl": name, "contentSize": f"{size} B", "encodingFormat": FILES[Path(name).suffix]}
        files.append({"@type": "cr:FileObject", "@id": name, "name": name, **about, "sha256": digest})
    files += [_set(name, media, names) for name, (media, names) in SETS.items() if fnmatch.filter(manifest, names)]
    sets = [_table(path.parent / name, key) for name, key in KEYS.items() if name in manifest]
    files_of_arrays, sets_of_arrays = _arrays(contents, [name for name in top if name.endswith(".tar")])
    dataset, licence = contents.dataset, licence_url(contents.licence) or contents.licence
    counts = sorted(Counter(record.class_name for record in dataset).items())
    stated = {"dataset": dataset, "counts": counts, "licence": licence, "source": contents.source}
    template = jinja2.Template(TEMPLATE.read_text(encoding="utf-8"), undefined=jinja2.StrictUndefined)
    described = json.loads(template.render(**stated, version=__version__, card=CARD, versions=versions(dataset)))
    described |= {"distribution": files + files_of_arrays, "recordSet": sets + sets_of_arrays}
    text = json.dumps(described, indent=1).replace("<", "\\u003c")  # ends no script element of a page that has it
    path.write_text(text + "\n", encoding="utf-8")


def _set(name: str, encoding: str, includes: str, archives: Sequence[str] = ()) -> dict[str, Any]:
    """A set of files of the export's folder, or of archives in it."""
    named = {"@type": "cr:FileSet", "@id": f"{name}-files", "name": name, "encodingFormat": encoding}
    return named | {"includes": includes} | ({"containedIn": [{"@id": each} for each in archives]} if archives else {})


def _arrays(contents: Contents, archives: Sequence[str]) -> tuple[list[dict[str, Any]], list[dict[str, Any]]]:
    """The sets of files, and of records, of arrays: one set of records for a table's columns, else one an array.
    archives: tar files that the arrays' files are in."""
    grasps, example, files, sets = contents.grasps, contents.example, [], []
    encoding, pattern, image_type = LAYOUTS[contents.layout.name]
    columns = [_field(grasps.units, name, "sc:Text", "metadata-files", column=name) for name in TEXT]
    columns.append(_field(grasps.units, grasps.unit, "cr:Int64", "metadata-files", column=grasps.unit))
    for name, (_, spec) in grasps.sources.items():
        kind, shape, images = example[name].dtype.name, example[name].shape, pictures(grasps, name, example[name])
        data_type = "sc:Boolean" if kind == "bool" else f"cr:{kind.title().replace('Ui', 'UI')}"
        if images and image_type:  # a file an image; a column has their names, a list if there are several
            data_type, shape = image_type, () if pattern or name in images else (len(images),)
        array = {"isArray": True, "arrayShape": ",".join(map(str, shape))} if shape else {}
        array["description"] = f"{spec.meaning}{spec.unit and f' ({spec.unit})'}"
        if not pattern:
            (column,) = contents.layout.names(name, [*images])
            columns.append(_field(grasps.units, column, data_type, "metadata-files", column=column) | array)
            continue
        files.append(_set(name, "image/png" if data_type == image_type else encoding, pattern.format(name), archives))
        fields = [_field(name, name, data_type, f"{name}-files", fileProperty="content") | array]
        if archives:
            fields.append(_field(name, "sample", "sc:Integer", f"{name}-files", fileProperty="filename"))
            fields[-1]["source"]["transform"] = {"regex": r"^(\d+)\..*$"}
        sets.append(_records(name, fields))
    return files, sets or [_records(grasps.units, columns, "object", grasps.unit)]


def _table(path: Path, key: str) -> dict[str, Any]:
    with path.open(encoding="utf-8", newline="") as file:
        columns = next(csv.reader(file))
    types = {name: "sc:Integer" if name in ("sample", "grasp", "press") else "sc:Text" for name in columns}
    return _records(path.stem, [_field(path.stem, name, types[name], path.name, column=name) for name in columns], key)


def _records(name: str, fields: list[dict[str, Any]], *key: str) -> dict[str, Any]:
    """A record set. key: names of the fields that tell records apart."""
    stated = {"key": [{"@id": f"{name}/{field}"} for field in key]} if key else {}
    return {"@type": "cr:RecordSet", "@id": name, "name": name, **stated, "field": fields}


def _field(records: str, name: str, data_type: str, files: str, **extract: str) -> dict[str, Any]:
    source = {"fileSet" if files.endswith("-files") else "fileObject": {"@id": files}, "extract": extract}
    field = {"@type": "cr:Field", "@id": f"{records}/{name}", "name": name}
    return field | {"dataType": data_type, "source": source}
