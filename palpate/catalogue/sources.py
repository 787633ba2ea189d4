"""Sources of objects: the mesh files of a source by class, and the names of objects.

Looking costs a listing of folders: no mesh is opened.
"""

import hashlib
import logging
import os
import re
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping
from pathlib import Path
from typing import Any, NamedTuple

from palpate.batch import UnusableObject
from palpate.configuration import ConfigError
from palpate.released.layout import SURFACES, ReleasedObject, read_released

log = logging.getLogger(__name__)

MESH_SUFFIXES = (".obj", ".glb", ".gltf", ".stl", ".ply", ".off", ".dae", ".3mf")
ABC_SUFFIXES = (".obj", ".stl")

# ShapeNetCore's folders of the paper's classes (WordNet synset offsets). Others are asked for by their
# number.
SYNSETS = {"bottle": "02876657", "knife": "03624134", "cellphone": "02992529", "rifle": "04090263"}

# As `palpate.shapes.CLASSES`; repeated here because that import loads mesh libraries, and the workflow looks
# at its source once a job.
PROCEDURAL = ("bottle", "knife", "cellphone", "rifle")

# The mesh within a model's folder, by version of ShapeNetCore.
SHAPENET_FILES = ("model.obj", "models/model_normalized.obj")

# The up axis of a source whose config does not say it.
UP_AXIS = {"procedural": "z", "folder": "z", "shapenet": "y", "abc": "z", "released": "z"}

Count = int | str


class CatalogueError(ValueError):
    """The source lacks what the config requests; the message names the place and the remedy."""


class SourceObject(NamedTuple):
    """An object: its name, its class, and its mesh file relative to the source's path, with forward
    slashes."""

    object: str
    class_name: str
    source: str


def scan(source: Mapping[str, Any], classes: Mapping[str, Count]) -> list[SourceObject]:
    """The objects of a run, class by class in the order asked for, within a class by name.

    `source` has `kind` (a key of `UP_AXIS`) and `path`; `classes` maps each class to a number of objects, or
    to "all". Of more objects than asked for, those are taken whose names have the smallest hashes: an even
    choice, the same on every machine. Procedural objects are listed whether their files have been written or
    not.

    Raises `CatalogueError` for an unknown kind or class, a missing folder, no mesh, fewer than asked for, or a
    link that leads nowhere.
    """
    kind = source["kind"]
    if kind not in _FINDERS:
        raise CatalogueError(f"source kind {kind!r}: expected one of {', '.join(_FINDERS)}")
    if not classes:
        raise CatalogueError("no classes: name at least one, with a number of objects or `all`")
    if kind == "abc" and len(classes) != 1:
        raise CatalogueError(f"source abc has one class, the config has {', '.join(classes)}: keep one of them")
    root = Path(source["path"])
    if kind != "procedural":
        _check_folder(root, kind)
    entries = []
    for name, count in classes.items():
        if _safe(name) != name:
            raise CatalogueError(f"class {name!r}: use letters, digits, '_', '.' and '-', beginning with no '.' or '-'")
        if count != "all" and (isinstance(count, bool) or not isinstance(count, int) or count < 1):
            raise CatalogueError(f"class {name}: expected a number of objects from 1 up, or `all`, not {count!r}")
        entries += _FINDERS[kind](root, name, count)
    if kind != "procedural":
        _check_links(root, entries)
    return entries


def all_classes(source: Mapping[str, Any]) -> dict[str, Count]:
    """Every class that a folder holds, with all of its objects: what `classes: all` stands for.

    A class is a folder of the source's path that isn't hidden and holds a mesh, at any depth (one that holds
    none is omitted with a warning); ShapeNet's are named where a name is known.
    Raises `CatalogueError` if the folder is missing or holds none, and for sources whose classes only the
    config knows.
    """
    kind, root = source["kind"], Path(source["path"])
    if kind == "released":
        return dict.fromkeys([each.class_name for each in _released_objects(root)], "all")
    if kind not in ("folder", "shapenet"):
        raise CatalogueError(f"classes: `all` means the folders of a folder or shapenet source; list those of {kind}")
    _check_folder(root, kind)
    folders = sorted(entry.name for entry in os.scandir(root) if entry.is_dir() and not entry.name.startswith("."))
    if kind == "shapenet":
        folders = [folder for folder in folders if re.fullmatch(r"\d{8}", folder)]
    empty = [folder for folder in folders if not _holds_mesh(root / folder, kind)]
    if empty:
        log.warning("%s: no mesh in %s: no classes", root, _listed(empty))
    if len(empty) == len(folders):
        raise CatalogueError(f"{root}: no folder of a class in it: put meshes in {root}/<class>/")
    names = {synset: name for name, synset in SYNSETS.items()} if kind == "shapenet" else {}
    return {names.get(folder, folder): "all" for folder in folders if folder not in empty}


def class_counts(config: Mapping[str, Any], source: Mapping[str, Any]) -> dict[str, Count]:
    """The number of objects, or "all", of each class that a checked config asks for, in its order.

    `source` is as for `scan`: `classes: all` means its folders. Raises `ConfigError` for a
    class that is listed twice, and `CatalogueError` as `all_classes` does.
    """
    if config["classes"] == "all":
        return all_classes(source)
    times = Counter(row["class"] for row in config["classes"])
    twice = [name for name, count in times.items() if count > 1]
    if twice:
        raise ConfigError(
            f"config classes: {', '.join(twice)} listed more than once: keep one entry of each class, "
            "with the number of objects that it shall have"
        )
    return {row["class"]: row["objects"] for row in config["classes"]}


def _holds_mesh(folder: Path, kind: str) -> bool:
    if kind == "shapenet":
        return any((folder / model / file).is_file() for model in os.listdir(folder) for file in SHAPENET_FILES)
    return any(True for _ in _each_mesh(folder, MESH_SUFFIXES))


def _check_folder(root: Path, kind: str) -> None:
    if not root.is_dir():
        raise CatalogueError(f"{root}: no such folder: set source.path to the folder of the {kind} source")


def _check_links(root: Path, entries: Iterable[SourceObject]) -> None:
    for entry in entries:
        path = root / entry.source
        if path.is_symlink() and not path.exists():
            raise CatalogueError(
                f"{path}: a link to {os.readlink(path)}, where there is no file: mend the link or remove it"
            )


def _procedural(root: Path, name: str, count: Count) -> list[SourceObject]:
    if name not in PROCEDURAL:
        raise CatalogueError(f"class {name}: the procedural classes are {', '.join(PROCEDURAL)}")
    if count == "all":
        raise CatalogueError(f"class {name}: procedural objects have no end: ask for a number, not for `all`")
    names = [f"{name}-{index:04d}" for index in range(count)]
    return [SourceObject(each, name, f"{name}/{each}{procedural_suffix(index)}") for index, each in enumerate(names)]


def procedural_suffix(index: int) -> str:
    """As `palpate.shapes.suffix`: every third is an OBJ, so that both formats are in use."""
    return ".obj" if index % 3 == 2 else ".glb"


def _folder(root: Path, name: str, count: Count) -> list[SourceObject]:
    folder = root / name
    if not folder.is_dir():
        present = sorted(entry.name for entry in os.scandir(root) if entry.is_dir())
        raise CatalogueError(
            f"{folder}: no such folder: the class {name} has its meshes there; {root} has {_listed(present)}"
        )
    files = _meshes(folder, MESH_SUFFIXES)
    return _chosen([SourceObject(_object(name, file), name, f"{name}/{file}") for file in files], folder, name, count)


def _abc(root: Path, name: str, count: Count) -> list[SourceObject]:
    files = _meshes(root, ABC_SUFFIXES)
    return _chosen([SourceObject(_object(name, file), name, file) for file in files], root, name, count)


def _shapenet(root: Path, name: str, count: Count) -> list[SourceObject]:
    synset = name if re.fullmatch(r"\d{8}", name) else SYNSETS.get(name)
    if synset is None:
        raise CatalogueError(
            f"class {name}: ShapeNet classes known by name are {', '.join(SYNSETS)}; name others by their "
            "synset number (eight digits)"
        )
    folder = root / synset
    if not folder.is_dir():
        raise CatalogueError(f"{folder}: no such folder: it holds ShapeNet's class {name}; unpack it there")
    entries, without = [], []
    for model in sorted(entry.name for entry in os.scandir(folder) if entry.is_dir()):
        file = next((file for file in SHAPENET_FILES if (folder / model / file).is_file()), None)
        if file is None:
            without.append(model)
        else:
            entries.append(SourceObject(_object(name, model), name, f"{synset}/{model}/{file}"))
    if without:
        log.warning("%s: no mesh in %d models: %s", folder, len(without), _listed(without))
    return _chosen(entries, folder, name, count)


def _released(root: Path, name: str, count: Count) -> list[SourceObject]:
    objects = _released_objects(root)
    entries = [SourceObject(_object(name, each.name), name, each.source) for each in objects if each.class_name == name]
    if not entries:
        present = dict.fromkeys(each.class_name for each in objects)
        raise CatalogueError(f"{root}: no object of class {name}; it has {_listed(present)}")
    return _chosen(entries, root / SURFACES / name, name, count)


def _released_objects(root: Path) -> list[ReleasedObject]:
    try:
        return read_released(root)
    except UnusableObject as error:
        raise CatalogueError(str(error)) from None


def given_splits(source: Mapping[str, Any]) -> dict[str, str]:
    """The splits that a source itself gives its objects, by name; empty where names decide."""
    if source["kind"] != "released":
        return {}
    objects = _released_objects(Path(source["path"]))
    return {_object(each.class_name, each.name): each.split for each in objects}


_FINDERS: dict[str, Callable[[Path, str, Count], list[SourceObject]]] = {
    "procedural": _procedural,
    "folder": _folder,
    "shapenet": _shapenet,
    "abc": _abc,
    "released": _released,
}


def _meshes(folder: Path, suffixes: tuple[str, ...]) -> list[str]:
    """Mesh files below the folder, relative to it, sorted; hidden files and folders are omitted."""
    return sorted(_each_mesh(folder, suffixes))


def _each_mesh(folder: Path, suffixes: tuple[str, ...]) -> Iterator[str]:
    for place, folders, files in os.walk(folder):
        folders[:] = [name for name in folders if not name.startswith(".")]
        for name in files:
            if name.lower().endswith(suffixes) and not name.startswith("."):
                yield (Path(place) / name).relative_to(folder).as_posix()


def _object(class_name: str, file: str) -> str:
    """The object's name: class and path without the suffix, folders joined by '-'.

    A path that has characters which are not safe in file names loses them and gets a hash of itself instead,
    so that different files keep different names.
    """
    stem = re.sub(rf"({'|'.join(map(re.escape, MESH_SUFFIXES))})$", "", file, flags=re.IGNORECASE)
    joined = stem.replace("/", "-")
    safe = re.sub(r"[^A-Za-z0-9_.-]", "_", joined)
    if safe != joined:
        safe += f"-{hashlib.sha256(stem.encode()).hexdigest()[:8]}"
    return f"{class_name}-{safe}"


def _safe(name: str) -> str:
    return re.sub(r"[^A-Za-z0-9_.-]", "_", str(name)).lstrip(".-")


def _chosen(entries: list[SourceObject], folder: Path, name: str, count: Count) -> list[SourceObject]:
    """`count` of the entries, sorted by name, after checking that there are enough and that names differ."""
    if not entries:
        raise CatalogueError(f"{folder}: no mesh found for class {name}: expected files {', '.join(MESH_SUFFIXES)}")
    by_name: dict[str, SourceObject] = {}
    for entry in entries:
        twin = by_name.setdefault(entry.object, entry)
        if twin is not entry:
            raise CatalogueError(
                f"{folder}: {twin.source} and {entry.source} would both be called {entry.object}: "
                "rename or remove one of them"
            )
    if count != "all":
        if len(entries) < count:
            raise CatalogueError(
                f"{folder}: {len(entries)} meshes of class {name}, the config asks for {count}: add meshes, "
                f"or ask for {len(entries)} or `all`"
            )
        entries = sorted(entries, key=lambda entry: hashlib.sha256(entry.object.encode()).digest())[:count]
    return sorted(entries)


def _listed(names: Iterable[str], most: int = 10) -> str:
    names = list(names)
    return (", ".join(names[:most]) or "nothing") + (", ..." if len(names) > most else "")
