"""Sources of objects: the mesh files of a source by class, and the names of objects.

Looking costs a listing of folders: no mesh is opened.
"""

import glob
import hashlib
import logging
import os
import re
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from fnmatch import fnmatchcase
from functools import cache
from pathlib import Path
from typing import Any, NamedTuple

from palpate import shapes
from palpate.batch import UnusableObject
from palpate.catalogue.companion_files import richness
from palpate.catalogue.object_table import ObjectTable, Scale, read_object_table
from palpate.configuration import ConfigError
from palpate.mesh import FORMATS
from palpate.named_files import HEAD, unusable
from palpate.released.layout import SURFACES, ReleasedObject, read_released

log = logging.getLogger(__name__)

MESH_SUFFIXES = tuple(f".{each}" for each in FORMATS)
# Of classes, as the schemas of config and catalogue have it: letters of any script and digits, with spaces and some
# signs between them.
CLASS_NAME = r"\w([\w .,()&'+-]*[\w.)+-])?"

# ShapeNetCore's folders of the paper's classes (WordNet synset offsets). Others are asked for by their
# number.
SYNSETS = {"bottle": "02876657", "knife": "03624134", "cellphone": "02992529", "rifle": "04090263"}

Count = int | str


class Layout(NamedTuple):
    """Where the data sets of a kind have their meshes, and how they stand.

    Attributes:
        patterns: of mesh files below the source's path, the best first; `{class}` is the folder of a class. An object
            is what its wildcards stand for, and has the first file that exists. `**` alone is any mesh, at any depth.
        up: the up axis, or `format`: that of the file's format (`FORMAT_UP`).
        suffixes: of mesh files.
    """

    patterns: tuple[str, ...]
    up: str
    suffixes: tuple[str, ...] = MESH_SUFFIXES


# Layouts as their publishers have them, unpacked. ShapeNetCore v1 and v2: a class's folder is its synset. ABC: chunks
# of OBJ or STL files. YCB: scans by Google's scanner, then those of Berkeley's, for not every object has all. Google
# Scanned Objects: as the zip files of Gazebo Fuel. Objaverse 1.0: as its package `objaverse` downloads it.
LAYOUTS = {
    "folder": Layout(("{class}/**",), "format"),
    "shapenet": Layout(("{class}/*/model.obj", "{class}/*/models/model_normalized.obj"), "y"),
    "abc": Layout(("**",), "z", (".obj", ".stl")),
    "ycb": Layout(
        tuple(f"*/{scan}/textured.obj" for scan in ("google_16k", "google_64k", "google_512k", "tsdf", "poisson")), "z"
    ),
    "google_scanned_objects": Layout(("*/meshes/model.obj",), "z"),
    "objaverse": Layout(("glbs/*/*.glb", "hf-objaverse-v1/glbs/*/*.glb"), "y"),
}
# glTF's is y (its specification, section 3.4). COLLADA files say theirs, or have y (`_collada_up`). Other formats have
# none, or allow any; CAD and scans have z as a rule.
FORMAT_UP = {".glb": "y", ".gltf": "y"}
# The up axis of a source whose config does not say it.
UP_AXIS = {"procedural": "z", "released": "z", **{kind: layout.up for kind, layout in LAYOUTS.items()}}
LONGEST_NAME = 200  # bytes of an object's name: 255 of a file's name, and what is added to it
ONE_CLASS = "object"  # of a source without folders of classes, where nothing else says one
DEFAULTS = {"pattern": None, "up": None, "scale": "diagonal", "objects": None, "variants": "best", "outside": False}


class CatalogueError(ValueError):
    """The source lacks what the config requests; the message names the place and the remedy."""


class SourceObject(NamedTuple):
    """An object, and how its mesh is taken.

    Attributes:
        object, class_name: names. source: its mesh file relative to the source's path, with forward slashes.
        up: the file's up axis. scale: `diagonal`, `keep`, or metres a unit of the file.
        split: what the source or the user gives it; empty where its name decides.
        others: further files of the same object, which are not used.
    """

    object: str
    class_name: str
    source: str
    up: str = "z"
    scale: Scale = "diagonal"
    split: str = ""
    others: tuple[str, ...] = ()


def scan(source: Mapping[str, Any], classes: Mapping[str, Count]) -> list[SourceObject]:
    """The objects of a run, class by class in the order asked for, within a class by name.

    `source` has `kind` (a key of `UP_AXIS`) and `path`, and may have the keys of `DEFAULTS`, as `resolve_source` gives
    them; `classes` maps each class to a number of objects, or to "all". Of more objects than asked for, those are
    taken whose names have the smallest hashes: an even choice, the same on every machine. Procedural objects are
    listed whether their files have been written or not.

    Raises `CatalogueError` for an unknown kind or class, a missing folder, no mesh, fewer than asked for, or a
    link that leads nowhere; `ConfigError` for the file of `objects`.
    """
    source = DEFAULTS | dict(source)
    kind, root = source["kind"], Path(source["path"])
    if kind not in UP_AXIS:
        raise CatalogueError(f"source kind {kind!r}: expected one of {', '.join(UP_AXIS)}")
    if not classes:
        raise CatalogueError("no classes: name at least one, with a number of objects or `all`")
    _check_classes(classes)
    if kind != "procedural":
        _check_folder(root, kind)
    table = _object_table(source)
    if kind in LAYOUTS and not table.gives_classes and not _has_class_folders(source) and len(classes) > 1:
        raise CatalogueError(
            f"source {kind} has one class, the config has {', '.join(classes)}: keep one of them, or say which object "
            "is of which class in a CSV file (source.objects)"
        )
    unknown = sorted(set(table.of_class) - set(classes))
    if unknown:
        log.warning("%s: lines about classes that this run does not have: %s", source["objects"], _listed(unknown))
    everything = _by_class(_candidates(source, None), table) if table.gives_classes else {}
    entries = []
    for name, count in classes.items():
        if kind == "procedural":
            entries += [_with_given(entry, table, source) for entry in _procedural(name, count)]
            continue
        if kind == "released":
            found, folder = _released(root, name), root / SURFACES / name
        elif table.gives_classes:
            found, folder = everything.get(name, []), Path(source["objects"])
        else:
            found, folder = _candidates(source, name), _place(source, name)
        if not found and source["pattern"]:
            raise CatalogueError(f"{root}: {_expected(source)}")
        entries += _chosen([_with_given(entry, table, source) for entry in found], folder, name, count)
    if kind != "procedural":
        _check_links(root, entries)
    return _distinct(entries)


def all_classes(source: Mapping[str, Any]) -> dict[str, Count]:
    """Every class that a source holds, with all of its objects: what `classes: all` stands for.

    A class is a folder of the source's path that isn't hidden and holds a mesh, at any depth (one that holds
    none is omitted with a warning); ShapeNet's are named where a name is known. A source without folders of classes
    has one, `ONE_CLASS`, but for what `objects` says.
    Raises `CatalogueError` if the folder is missing or holds none, and for procedural objects, which have no end.
    """
    source = DEFAULTS | dict(source)
    kind, root = source["kind"], Path(source["path"])
    if kind == "released":
        return dict.fromkeys([each.class_name for each in _released_objects(root)], "all")
    if kind not in LAYOUTS:
        raise CatalogueError(f"classes: `all` means the classes of files that there are; list those of {kind}")
    _check_folder(root, kind)
    table = _object_table(source)
    if table.gives_classes or source["pattern"] or not _has_class_folders(source):
        found = _by_class(_candidates(source, None), table)
        if not found:
            raise CatalogueError(f"{root}: {_expected(source)}")
        return dict.fromkeys(sorted(found), "all")
    folders = _class_folders(root, kind)
    empty = [folder for folder in folders if not _holds_mesh(root / folder, kind)]
    if empty:
        log.warning("%s: no mesh in %s: no classes", root, _listed(empty))
    if len(empty) == len(folders):
        raise CatalogueError(
            f"{root}: no folder of a class in it: put meshes in {root}/<class>/, or set source.pattern "
            '("*.obj" for files without such folders)'
        )
    return {_class_of_folder(folder, kind): "all" for folder in folders if folder not in empty}


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


def _check_folder(root: Path, kind: str) -> None:
    if not root.is_dir():
        raise CatalogueError(f"{root}: no such folder: set source.path to the folder of the {kind} source")


def _check_links(root: Path, entries: Iterable[SourceObject]) -> None:
    for entry in entries:
        path = os.path.join(root, entry.source)
        if os.path.islink(path) and not os.path.exists(path):
            raise CatalogueError(
                f"{path}: a link to {os.readlink(path)}, where there is no file: mend the link or remove it"
            )


def _check_classes(classes: Mapping[str, Count]) -> None:
    file_names: dict[str, str] = {}
    for name, count in classes.items():
        if not re.fullmatch(CLASS_NAME, str(name)):
            raise CatalogueError(
                f"class {name!r}: use letters, digits, spaces, '_', '.' and '-', beginning with a letter, digit or '_'"
            )
        if count != "all" and (isinstance(count, bool) or not isinstance(count, int) or count < 1):
            raise CatalogueError(f"class {name}: expected a number of objects from 1 up, or `all`, not {count!r}")
        twin = file_names.setdefault(file_name(name), name)
        if twin != name:
            raise CatalogueError(f"classes {twin!r} and {name!r} would have files of one name: rename one of them")


def _object_table(source: Mapping[str, Any]) -> ObjectTable:
    return read_object_table(source["objects"], source["path"]) if source["objects"] else ObjectTable()


def _patterns(source: Mapping[str, Any]) -> tuple[str, ...]:
    return (source["pattern"],) if source["pattern"] else LAYOUTS[source["kind"]].patterns


def _has_class_folders(source: Mapping[str, Any]) -> bool:
    return source["kind"] in LAYOUTS and all("{class}" in pattern.split("/") for pattern in _patterns(source))


def _place(source: Mapping[str, Any], name: str) -> Path:
    """The folder that a class's meshes are in, for messages."""
    root = Path(source["path"])
    own = _has_class_folders(source) and not source["pattern"]
    return root / _folder_of_class(name, source["kind"]) if own else root


def _expected(source: Mapping[str, Any]) -> str:
    """What to say of a source in which no mesh is found."""
    said = f"no mesh found for {' or '.join(_patterns(source))}"
    if not source["pattern"]:
        return f"{said}: expected files {', '.join(LAYOUTS[source['kind']].suffixes)}"
    inner = "" if "{class}" in source["pattern"] else " (patterns begin at source.path; `{class}/...` has classes)"
    return f"{said}: correct source.pattern{inner}"


def _class_folders(root: Path, kind: str) -> list[str]:
    folders = sorted(entry.name for entry in os.scandir(root) if entry.is_dir() and not entry.name.startswith("."))
    return [folder for folder in folders if kind != "shapenet" or re.fullmatch(r"\d{8}", folder)]


def _class_of_folder(folder: str, kind: str) -> str:
    names = {synset: name for name, synset in SYNSETS.items()} if kind == "shapenet" else {}
    return names.get(folder, folder)


def _folder_of_class(name: str, kind: str) -> str:
    if kind != "shapenet" or re.fullmatch(r"\d{8}", name):
        return name
    if name not in SYNSETS:
        raise CatalogueError(
            f"class {name}: ShapeNet classes known by name are {', '.join(SYNSETS)}; name others by their "
            "synset number (eight digits)"
        )
    return SYNSETS[name]


def _holds_mesh(folder: Path, kind: str) -> bool:
    layout = LAYOUTS[kind]
    if layout.patterns == ("{class}/**",):
        return any(True for _ in _each_mesh(folder, layout.suffixes))
    return any(_matches(folder, pattern.removeprefix("{class}/"), layout) for pattern in layout.patterns)


class _Candidate(NamedTuple):
    """A mesh file that may be taken: its class, its path below the source's, and the part of it that names it."""

    class_name: str
    file: str
    name: str
    others: tuple[str, ...] = ()


def _candidates(source: Mapping[str, Any], class_name: str | None) -> list[SourceObject]:
    """The objects of a class, or of all classes, without what users say of them."""
    kind, root = source["kind"], Path(source["path"])
    candidates: list[_Candidate] = []
    for pattern in _patterns(source):
        better = {(each.class_name, each.name): place for place, each in enumerate(candidates)}
        for each in _of_pattern(root, pattern, kind, class_name):
            place = better.get((each.class_name, each.name))
            if place is None:
                candidates.append(each)
            else:
                candidates[place] = candidates[place]._replace(others=(*candidates[place].others, each.file))
    if not source["pattern"]:
        _warn_of_folders_without(root, kind, class_name, candidates)
    if source["variants"] == "best":
        candidates = _best_variants(root, candidates, files_root(source))
    return [
        SourceObject(each.name, each.class_name, each.file, others=tuple(sorted(each.others))) for each in candidates
    ]


def _of_pattern(root: Path, pattern: str, kind: str, class_name: str | None) -> Iterator[_Candidate]:
    """The mesh files that a pattern matches; class_name: of this class, or None for those of all."""
    layout, steps = LAYOUTS[kind], pattern.split("/")
    if "{class}" not in steps:
        of_class = dict.fromkeys([""], class_name or ONE_CLASS)
    else:
        place = steps.index("{class}")
        before = "/".join(steps[:place])
        if class_name is not None:
            folder = _folder_of_class(class_name, kind)
            _check_class_folder(root, before, folder, class_name, kind)
            of_class = {folder: class_name}
        else:
            above = [Path(each) for each in _matching_folders(root, before)]
            of_class = {
                folder: _class_of_folder(folder, kind) for each in above for folder in _class_folders(root / each, kind)
            }
    for folder, name in sorted(of_class.items()):
        filled = [glob.escape(folder) if step == "{class}" else step for step in steps]
        fixed = [not glob.has_magic(step) or step == glob.escape(folder) != "" for step in filled]
        head = next((i for i, each in enumerate(fixed) if not each), 0)
        tail = next((i for i, each in enumerate(fixed[::-1]) if not each), 0)
        for file in _matches(root, "/".join(filled), layout):
            parts = file.split("/")
            kept = "/".join(parts[head : len(parts) - tail])
            yield _Candidate(name, file, kept if tail else _without_suffix(kept))


def _matching_folders(root: Path, pattern: str) -> list[str]:
    return sorted(glob.glob(f"{pattern}/", root_dir=root)) if pattern else ["."]


def _check_class_folder(root: Path, before: str, folder: str, class_name: str, kind: str) -> None:
    if glob.has_magic(before) or (root / before / folder).is_dir():
        return
    path = root / before / folder
    if kind == "shapenet":
        raise CatalogueError(f"{path}: no such folder: it holds ShapeNet's class {class_name}; unpack it there")
    present = _class_folders(path.parent, kind) if path.parent.is_dir() else []
    raise CatalogueError(
        f"{path}: no such folder: the class {class_name} has its meshes there; {path.parent} has {_listed(present)}"
    )


def _matches(root: Path, pattern: str, layout: Layout) -> list[str]:
    """Mesh files below a folder that a pattern matches, relative to it, sorted; hidden files and folders never."""
    steps = pattern.split("/")
    if "**" in steps:
        depth = steps.index("**")
        rest = [*steps[depth:], "*"] if steps[-1] == "**" else steps[depth:]
        folders = [f"{each}/" for each in glob.glob("/".join(steps[:depth]), root_dir=root)] if depth else [""]
        found = [
            folder + file
            for folder in folders
            for file in _each_mesh(root / folder, layout.suffixes)
            if _fits(file.split("/"), rest)
        ]
    else:
        found = glob.glob(pattern, root_dir=root)
        found = [file for file in found if file.lower().endswith(layout.suffixes) and not (root / file).is_dir()]
    return sorted(file.encode("utf-8", "backslashreplace").decode() for file in found)  # see `named_files.unusable`


def _fits(parts: Sequence[str], steps: Sequence[str]) -> bool:
    """Whether the parts of a path are what a pattern's steps stand for; `**` stands for any folders."""
    if not parts or not steps:
        return not parts and not steps
    if steps[0] == "**":
        return any(_fits(parts[start:], steps[1:]) for start in range(len(parts)))
    return fnmatchcase(parts[0], steps[0]) and _fits(parts[1:], steps[1:])


def _warn_of_folders_without(root: Path, kind: str, class_name: str | None, found: Iterable[_Candidate]) -> None:
    """Name the objects' folders of a published layout in which no mesh is."""
    pattern = LAYOUTS[kind].patterns[0].split("/")
    of_class = pattern[0] == "{class}"
    if "*" in pattern[-1] or (of_class and class_name is None):
        return
    place = root / _folder_of_class(class_name, kind) if of_class else root
    names = {each.name for each in found}
    without = [
        entry.name
        for entry in os.scandir(place)
        if entry.is_dir() and entry.name not in names and not entry.name.startswith(".")
    ]
    if without:
        log.warning("%s: no mesh in %d models: %s", place, len(without), _listed(sorted(without)))


# What tells apart files of one object: `textured.obj` and `nontextured.stl`, `mug_textured.obj` and `mug.stl`.
VARIANT = re.compile(r"[-_ .]?(?<![A-Za-z0-9])((non|un)[-_]?)?textured(?![A-Za-z0-9])", re.IGNORECASE)


def _best_variants(root: Path, candidates: list[_Candidate], files: str) -> list[_Candidate]:
    """One candidate for all files of a folder that differ in format or texture only: the one that holds most."""
    groups: dict[tuple[str, str], list[_Candidate]] = {}
    for each in candidates:
        folder, _, file = each.file.rpartition("/")
        groups.setdefault((folder, VARIANT.sub("", _without_suffix(file))), []).append(each)

    def rank(each: _Candidate) -> tuple:
        return -richness(root / each.file, files), MESH_SUFFIXES.index(Path(each.file).suffix.lower()), each.file

    chosen = []
    for group in groups.values():
        best, *others = sorted(group, key=rank) if len(group) > 1 else group
        chosen.append(best._replace(others=(*best.others, *(each.file for each in others))))
    return chosen


def _by_class(entries: Iterable[SourceObject], table: ObjectTable) -> dict[str, list[SourceObject]]:
    """The objects of each class, after what users say of classes."""
    found: dict[str, list[SourceObject]] = {}
    for entry in entries:
        name = table.of(entry.source, entry.class_name).class_name
        found.setdefault(name, []).append(entry._replace(class_name=name))
    return found


def _with_given(entry: SourceObject, table: ObjectTable, source: Mapping[str, Any]) -> SourceObject:
    """An object with its own name, up axis, scale and split."""
    if source["kind"] in ("procedural", "released"):
        return entry._replace(up=source["up"] or UP_AXIS[source["kind"]], scale=source["scale"])
    given = table.of(entry.source, entry.class_name)
    up = given.up or source["up"] or UP_AXIS[source["kind"]]
    if up == "format":
        suffix = os.path.splitext(entry.source)[1].lower()
        up = _collada_up(Path(source["path"], entry.source)) if suffix == ".dae" else FORMAT_UP.get(suffix, "z")
    return entry._replace(
        object=_object(entry.class_name, entry.object),
        up=up,
        scale=given.scale or source["scale"],
        split=given.split or entry.split,
    )


def _collada_up(path: Path) -> str:
    """The up axis that a COLLADA file says, which has it at its top; y if it says none."""
    if unusable(path):
        return "y"
    with open(path, "rb") as file:
        found = re.search(rb"<up_axis>\s*([XYZ])_UP", file.read(HEAD))
    return found[1].decode().lower() if found else "y"


def files_root(source: Mapping[str, Any]) -> str:
    """The folder that files have to be in which meshes name: the source's, or any with `outside`."""
    return "/" if source.get("outside") else str(source["path"])


def _procedural(name: str, count: Count) -> list[SourceObject]:
    if name not in shapes.CLASSES:
        raise CatalogueError(f"class {name}: the procedural classes are {', '.join(shapes.CLASSES)}")
    if count == "all":
        raise CatalogueError(f"class {name}: procedural objects have no end: ask for a number, not for `all`")
    names = [f"{name}-{index:04d}" for index in range(count)]
    return [SourceObject(each, name, f"{name}/{each}{shapes.suffix(index)}") for index, each in enumerate(names)]


def _released(root: Path, name: str) -> list[SourceObject]:
    objects = _released_objects(root)
    entries = [
        SourceObject(_object(name, each.name), name, each.source, split=each.split)
        for each in objects
        if each.class_name == name
    ]
    if not entries:
        present = dict.fromkeys(each.class_name for each in objects)
        raise CatalogueError(f"{root}: no object of class {name}; it has {_listed(present)}")
    return entries


def _released_objects(root: Path) -> list[ReleasedObject]:
    try:
        return read_released(root)
    except UnusableObject as error:
        raise CatalogueError(str(error)) from None


def _each_mesh(folder: Path, suffixes: tuple[str, ...]) -> Iterator[str]:
    for place, folders, files in os.walk(folder, followlinks=True):
        folders[:] = [name for name in folders if not name.startswith(".") and not _returns(folder, Path(place, name))]
        within = Path(place).relative_to(folder).as_posix()  # once a folder: there may be 100,000 files
        for name in files:
            if name.lower().endswith(suffixes) and not name.startswith("."):
                yield name if within == "." else f"{within}/{name}"


def _returns(top: Path, folder: Path) -> bool:
    """Whether a folder below `top` is a link to one that it lies in, by its path or in truth: to follow has no end."""
    if not folder.is_symlink():
        return False
    target = os.path.realpath(folder)
    above = [os.path.realpath(each) for each in folder.parents if each == top or top in each.parents]
    return any(os.path.commonpath((each, target)) == target for each in above)


MESH_SUFFIX = re.compile(rf"({'|'.join(map(re.escape, MESH_SUFFIXES))})$", re.IGNORECASE)


def _without_suffix(file: str) -> str:
    return MESH_SUFFIX.sub("", file)


@cache
def file_name(class_name: str) -> str:
    """A class's name as a part of file names: spaces are `_`; where other characters have to go, a hash follows."""
    spaced = class_name.replace(" ", "_")
    safe = re.sub(r"[^A-Za-z0-9_.-]", "_", spaced)
    return safe if safe == spaced else f"{safe}-{_hash(class_name)}"


def _hash(text: str) -> str:
    return hashlib.sha256(text.encode()).hexdigest()[:8]


def _object(class_name: str, path: str) -> str:
    """The object's name: class and path, folders joined by '-'; what repeats the part before it is left out.

    A path that has characters which are not safe in file names loses them and gets a hash of itself instead,
    so that different files keep different names. So does one that is too long for a file's name.
    """
    parts = [class_name, *path.split("/")]
    joined = "-".join(part for before, part in zip(parts, parts[1:], strict=False) if part != before)
    safe = re.sub(r"[^A-Za-z0-9_.-]", "_", joined)
    name = f"{file_name(class_name)}-{safe}" if safe else file_name(class_name)
    if len(name) > LONGEST_NAME:
        return f"{name[: LONGEST_NAME - 9]}-{_hash(path)}"
    return name if safe == joined else f"{name}-{_hash(path)}"


def _distinct(entries: list[SourceObject]) -> list[SourceObject]:
    """The entries, with a hash of the file at the end of each name that one before it has already."""
    taken: set[str] = set()
    renamed = []
    for entry in entries:
        name = entry.object
        if name in taken:
            name += f"-{_hash(entry.source)}"
            log.warning("%s: the name %s is another object's: called %s", entry.source, entry.object, name)
        taken.add(name)
        renamed.append(entry._replace(object=name))
    return renamed


def _chosen(entries: list[SourceObject], folder: Path, name: str, count: Count) -> list[SourceObject]:
    """`count` of the entries, sorted by name, after checking that there are enough.

    Names differ: of two alike that with fewer folders above its file keeps it, so that one which is there mostly does.
    """
    if not entries:
        raise CatalogueError(f"{folder}: no mesh found for class {name}: expected files {', '.join(MESH_SUFFIXES)}")
    entries = _distinct(sorted(entries, key=lambda entry: (entry.source.count("/"), entry.source)))
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
