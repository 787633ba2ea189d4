"""The description of an export in Croissant 1.0, MLCommons' JSON-LD for search engines and loaders.

https://docs.mlcommons.org/croissant/docs/croissant-spec-1.0.html. Record sets are `objects`, `grasps`, and in
WebDataset each name of images; arrays in `.npy` files are sets of files. Fields `rai:` are those of its extension for
responsible AI, https://docs.mlcommons.org/croissant/docs/croissant-rai-spec.html.
"""

import json
from collections import Counter
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

from palpate import __version__
from palpate.checksums import Manifest
from palpate.dataset import Dataset, GraspDataset
from palpate.interchange.items import CARD, TEXT, pictures, versions

CONFORMS = ["http://mlcommons.org/croissant/1.0", "http://mlcommons.org/croissant/RAI/1.0"]
TERMS = (
    "citeAs column equivalentProperty extract field fileObject fileProperty fileSet format includes isLiveDataset "
    "jsonPath key md5 parentField path recordSet references regex repeated replace samplingRate separator source "
    "subField transform"
)
# The specification's own, in full: readers warn of another.
CONTEXT = {
    **{"@language": "en", "@vocab": "https://schema.org/", "sc": "https://schema.org/"},
    **{"cr": "http://mlcommons.org/croissant/", "rai": "http://mlcommons.org/croissant/RAI/"},
    **{"dct": "http://purl.org/dc/terms/", "conformsTo": "dct:conformsTo"},
    **{name: f"cr:{name}" for name in TERMS.split()},
    **{name: {"@id": f"cr:{name}", "@type": "@json"} for name in ("data", "examples")},
    "dataType": {"@id": "cr:dataType", "@type": "@vocab"},
}
KINDS = {"b": "sc:Boolean", "i": "sc:Integer", "u": "sc:Integer", "f": "sc:Float"}  # by numpy's kinds


def write_croissant(
    path: Path, dataset: Dataset, splits: Mapping[str, GraspDataset], manifest: Manifest, licence: str, source: str
) -> None:
    """Write the description of an export whose files are in `manifest`, without a date.

    The other arguments are those of `export`.
    """
    grasps, archives = next(iter(splits.values())), [name for name in manifest if name.endswith(".tar")]
    files = [_file(name, manifest) for name in manifest if name.endswith((".csv", ".json")) and "/" not in name]
    if any(name.startswith("meshes/") for name in manifest):
        files.append(_set("meshes", "model/gltf-binary", "meshes/*.glb"))
    columns = {name: _column("objects", name) for name in ("object", "class", "split", "mesh")}
    sets = [_records("objects", "The objects, and where their meshes are", columns, "object")]
    if archives:
        more_files, more_sets = _webdataset(manifest, archives, grasps)
    elif any(name.endswith(".parquet") for name in manifest):
        more_files, more_sets = _parquet(grasps)
    else:
        more_files, more_sets = [_set(split, "application/vnd.zarr", f"{split}.zarr/**") for split in splits], []
    described = {
        **{"@context": CONTEXT, "@type": "sc:Dataset", "conformsTo": CONFORMS},
        **{"name": dataset.name, "license": licence, "version": "1.0.0"},
        "description": f"Simulated grasps of {len(dataset)} objects: what touch sensors and cameras record of each. "
        f"Made by palpate {__version__}. Source of the meshes: {source or 'not stated'}.",
        "keywords": ["tactile", "vision", "robotics", "3d", "simulation"],
        **{f"rai:{name}": value for name, value in _responsible(dataset, source).items()},
        "distribution": files + more_files,
        "recordSet": sets + more_sets,
    }
    text = json.dumps(described, indent=1).replace("<", "\\u003c")  # ends no script element of a page that has it
    path.write_text(text + "\n", encoding="utf-8")


def _responsible(dataset: Dataset, source: str) -> dict[str, str | list[str]]:
    """The fields of responsible AI that a run can answer, without their prefix."""
    counts = sorted(Counter(record.class_name for record in dataset).items())
    return {
        "dataCollection": "A simulated hand grasps meshes. Touch is ray cast and shaded, images are rendered. No robot "
        f"or person was recorded. {CARD} has the config.",
        "dataCollectionType": ["Software Collection"],
        "dataCollectionMissingData": f"{len(dataset.rejections())} objects could not be used and are left out, with "
        f"reasons in {CARD}. A sensor that touched nothing reads the empty gel.",
        "dataCollectionRawData": f"Meshes. Their source: {source or 'not stated'}.",
        "dataPreprocessingProtocol": ["Meshes are repaired without changing their shape, scaled and centred."],
        "dataAnnotationProtocol": ["None by people: depths, clouds, masks and poses are computed from the meshes."],
        "machineAnnotationTools": list(map(" ".join, versions(dataset).items())),
        "dataBiases": [
            f"Objects by class: {', '.join(f'{name} {count}' for name, count in counts)}.",
            "Objects that the hand could not grasp are missing.",
        ],
        "dataLimitations": [
            "Touch is geometry within the sensor's range: no deformed gel, force, slip or markers.",
            "Objects are held still while fingers close: grasps need not be able to lift them.",
        ],
        "dataUseCases": ["Reconstruction of 3D shape from vision and touch: training and evaluation in simulation."],
        "dataSocialImpact": "None on people is known. Models need tests on real sensors before a robot relies on them.",
        "personalSensitiveInformation": ["None is added. Meshes and textures were not searched for any."],
    }


def _file(name: str, manifest: Manifest) -> dict[str, Any]:
    size, digest = manifest[name]
    encoding = {".csv": "text/csv", ".json": "application/json", ".tar": "application/x-tar"}[Path(name).suffix]
    stated = {"contentUrl": name, "contentSize": f"{size} B", "encodingFormat": encoding, "sha256": digest}
    return {"@type": "cr:FileObject", "@id": name, "name": name, **stated}


def _set(name: str, encoding: str, includes: str, archives: Iterable[str] = (), about: str = "") -> dict[str, Any]:
    """A set of files, of archives or of the export's folder."""
    within = {"containedIn": [{"@id": each} for each in archives]} if archives else {}
    stated = {"description": about or name, **within, "encodingFormat": encoding, "includes": includes}
    return {"@type": "cr:FileSet", "@id": f"{name}-files", "name": name, **stated}


def _column(table: str, name: str, kind: str = "sc:Text") -> dict[str, Any]:
    """A field that is a column of `<table>.csv`."""
    return {"dataType": kind, "source": {"fileObject": {"@id": f"{table}.csv"}, "extract": {"column": name}}}


def _records(name: str, about: str, fields: Mapping[str, dict], *key: str) -> dict[str, Any]:
    """A record set, with the names of the fields that are its key."""
    described = [{"@type": "cr:Field", "@id": f"{name}/{key}", "name": key, **each} for key, each in fields.items()]
    stated = {"description": about, "key": [{"@id": f"{name}/{each}"} for each in key], "field": described}
    return {"@type": "cr:RecordSet", "@id": name, "name": name, **stated}


def _about(grasps: GraspDataset, item: Mapping[str, Any], name: str) -> str:
    spec = grasps.sources[name][1]
    return f"{spec.meaning}. Array {item[name].shape}, {item[name].dtype}{f', {spec.unit}' if spec.unit else ''}."


def _parquet(grasps: GraspDataset) -> tuple[list[dict], list[dict]]:
    """Sets of files and records of Parquet and images."""
    files = [_set("metadata", "application/x-parquet", "*/metadata.parquet")]
    files.append(_set("images", "image/png", "*/*/*/*.png"))
    item, fields = grasps[0], {}
    for name, value in item.items():
        field: dict[str, Any] = {"dataType": "sc:Integer" if name == "grasp" else "sc:Text"}
        if name in grasps.images:
            several = name not in pictures(name, value, grasps.images[name])
            field |= {"description": _about(grasps, item, name), "repeated": several}
            name += "_file_names" if several else "_file_name"
        elif name in grasps.sources:
            field = {"dataType": KINDS[value.dtype.kind], "repeated": value.ndim > 0}
            field["description"] = _about(grasps, item, name)
        source = {"fileSet": {"@id": "metadata-files"}, "extract": {"column": name}}
        fields[name] = field | {"source": source}
    return files, [_records("grasps", "Grasps; images by their paths in the split", fields, "object", "grasp")]


def _webdataset(manifest: Manifest, archives: list[str], grasps: GraspDataset) -> tuple[list[dict], list[dict]]:
    """Files and records of tar shards: the grasps, and the images of each name by sample."""
    item, files = grasps[0], [_file(name, manifest) for name in archives]
    fields = {name: _column("grasps", name, "sc:Integer") for name in ("sample", "grasp")}
    fields |= {name: _column("grasps", name) for name in TEXT}
    sets = [_records("grasps", "Grasps, each a sample of the tar shards", fields, "sample")]
    for name in grasps.sources:
        about = _about(grasps, item, name)
        if name not in grasps.images:
            files.append(_set(name, "application/x-npy", f"*.{name}.npy", archives, about))
            continue
        for each in pictures(name, item[name], grasps.images[name]):
            files.append(_set(each, "image/png", f"*.{each}.png", archives, about))
            of_file = {"fileSet": {"@id": f"{each}-files"}}
            number = of_file | {"extract": {"fileProperty": "filename"}, "transform": {"regex": r"^(\d+)\."}}
            image = {"dataType": "sc:ImageObject", "source": of_file | {"extract": {"fileProperty": "content"}}}
            fields = {"sample": {"dataType": "sc:Integer", "source": number}, "image": image}
            sets.append(_records(each, about, fields, "sample"))
    return files, sets
