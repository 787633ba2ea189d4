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

from palpate import __version__
from palpate.checksums import Manifest
from palpate.dataset import Dataset
from palpate.interchange.items import CARD, versions

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
    described = {
        **{"@context": CONTEXT, "@type": "sc:Dataset", "conformsTo": CONFORMS},
        **{"name": dataset.name, "license": licence, "version": "1.0.0"},
        "description": f"Simulated grasps of {len(dataset)} objects: what touch sensors and cameras record of each. "
        f"Made by palpate {__version__}. Source of the meshes: {source or 'not stated'}.",
        "keywords": ["tactile", "vision", "robotics", "3d", "simulation"],
        **{f"rai:{name}": value for name, value in _responsible(dataset, source).items()},
        "distribution": files,
        "recordSet": sets,
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
