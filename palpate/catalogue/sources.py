"""The objects of a source: its mesh files by class, and the names of objects. Folders are listed, no mesh is opened."""

import glob
import hashlib
import logging
import os
import re
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from functools import cache
from pathlib import Path, PurePosixPath
from typing import Any, NamedTuple
from unicodedata import normalize

from palpate import shapes
from palpate.batch import UnusableObject, generator
from palpate.catalogue.source import FORMAT_UP, LAYOUTS, MESH_SUFFIXES, CatalogueError, ObjectTable, Scale, Source
from palpate.catalogue.variants import is_general, of_one_object
from palpate.configuration import ConfigError
from palpate.named_files import HEAD, UNREAD, unusable
from palpate.released.layout import read_released, subfolders

log = logging.getLogger(__name__)

# Letters of any script and digits, with their marks, which `\w` lacks: vowel signs of Devanagari, accents, joiners.
LETTERS = r"\w\u0300-\u1fff\u200c\u200d\u20d0-\u20ff\u302a-\u309a\ua66f-\uabff"
# Of classes, as the schema of the config has it: letters, with spaces and some signs between them.
CLASS_NAME = rf"\w([{LETTERS} .,()&'+-]*[{LETTERS}.)+-])?"
LONGEST_NAME = 200  # bytes of an object's name: 255 of a file's name, and what is added to it
ONE_CLASS = "object"  # of a source without folders of classes, where nothing else says one
MESH_SUFFIX, UNREAD_SUFFIX = (
    re.compile(rf"({'|'.join(map(re.escape, suffixes))})$", re.IGNORECASE) for suffixes in (MESH_SUFFIXES, UNREAD)
)
# The file of one object that is taken of several: formats that may have textures come first.
PREFERENCE = (".glb", ".gltf", ".obj", ".dae", ".ply", ".3mf", ".off", ".stl")

Count = int | str


class SourceObject(NamedTuple):
    """An object, and how its mesh is taken."""

    object: str  # its name
    class_name: str
    source: str  # its mesh file relative to the source's path, with forward slashes
    up: str = "z"  # the file's up axis
    scale: Scale = "diagonal"
    split: str = ""  # what the source or the user gives it; empty where its name decides
    others: tuple[str, ...] = ()  # further files of the same object, which are not used
    turn: float = 0.0  # degrees about the vertical, counter-clockwise from above


def scan(source: Source, classes: Mapping[str, Count]) -> list[SourceObject]:
    """The objects of a run, class by class in the order asked for, within a class by name; procedural ones whether
    their files are there or not. classes: the number of objects of each, or "all"; of more, those with the smallest
    hashes are taken. Raises `CatalogueError` for an unknown class, a missing folder, no mesh, fewer than asked for, or
    a link that leads nowhere; `ConfigError` for the file of `objects`."""
    file_names: dict[str, str] = {}
    for name, count in classes.items():
        if not re.fullmatch(CLASS_NAME, str(name)):
            raise CatalogueError(
                f"class {name!r}: use letters, digits, spaces, '_', '.' and '-', beginning with a letter, digit or '_'"
            )
        if count != "all" and (isinstance(count, bool) or not isinstance(count, int) or count < 1):
            raise CatalogueError(f"class {name}: expected a number of objects from 1 up, or `all`, not {count!r}")
        if (twin := file_names.setdefault(file_name(name), name)) != name:
            raise CatalogueError(f"classes {twin!r} and {name!r} would have files of one name: rename one of them")
    if source.kind == "procedural":
        return _turned(source, (entry for name, count in classes.items() for entry in _procedural(source, name, count)))
    root, table = source.opened()
    if source.kind in LAYOUTS and not table.gives_classes and not source.has_class_folders and len(classes) > 1:
        raise CatalogueError(
            f"source {source.kind} has one class, the config has {', '.join(classes)}: keep one of them, or say which "
            "object is of which class in a CSV file (source.objects)"
        )
    everything = _by_class(source, table) if source.kind == "released" or table.gives_classes else None
    entries = []
    for name, count in classes.items():
        if everything is not None:
            candidates, place = everything.get(name, []), Path(source.objects or root)
            if not candidates:
                raise CatalogueError(f"{place}: no object of class {name}; there are {listed(sorted(everything))}")
        else:
            candidates = _candidates(source, name, table)
            own_folder = source.has_class_folders and not source.pattern
            place = root / source.folder_of(name) if own_folder else root
        if not candidates and source.pattern:
            raise CatalogueError(_no_mesh(source))
        entries += _chosen([_described(entry, table, source) for entry in candidates], place, name, count)
    for entry in entries:
        path = os.path.join(root, entry.source)
        if os.path.islink(path) and not os.path.exists(path):
            raise CatalogueError(
                f"{path}: a link to {os.readlink(path)}, where there is no file: correct the link or remove it"
            )
    return _turned(source, _distinct(entries))


def style_of(name: str, class_name: str, seed: int) -> str:
    """The style of a procedural object."""
    return shapes.style(class_name, int(name.removeprefix(f"{class_name}-")), seed)


def all_classes(source: Source) -> dict[str, Count]:
    """Every class of a source, with all objects: `classes: all`. A class is a folder of the source's path that isn't
    hidden and holds a mesh, at any depth; without folders of classes there is `ONE_CLASS`, but for what `objects` says.
    Raises `CatalogueError` if the folder is missing or holds none, and for procedural objects, which have no end."""
    if source.kind == "procedural":
        raise CatalogueError("classes: `all` means the classes of files that there are; list those of procedural")
    root, table = source.opened()
    changes = table.gives_classes or any(given.exclude == "yes" for given in table.values())
    if source.has_class_folders and not source.pattern and not changes:
        folders = source.class_folders(root)
        full = [folder for folder in folders if any(next(_matches(root, each, folder), "") for each in source.patterns)]
        if empty := [folder for folder in folders if folder not in full]:
            log.warning("%s: no mesh in %s: no classes", root, listed(empty))
        if not full:
            raise CatalogueError(
                f"{root}: no folder of a class in it: put meshes in {root}/<class>/, or set source.pattern "
                '("*.obj" for files without such folders)'
            )
        return dict.fromkeys(map(source.class_of, full), "all")
    by_class = _by_class(source, table)
    if not by_class:
        raise CatalogueError(_no_mesh(source))
    return dict.fromkeys(sorted(by_class), "all")


def unread_lines(source: Source) -> list[str]:
    """Lines on files below the source's path that have 3D data in formats that are not read, and what to do."""
    of_format: dict[tuple[str, str], list[str]] = {}
    if source.kind in LAYOUTS and Path(source.path).is_dir():
        for file in _each_mesh(Path(source.path), UNREAD_SUFFIX):
            of_format.setdefault(UNREAD[os.path.splitext(file)[1].lower()], []).append(file)
    return [
        f"{len(files)} {name} file{'s' * (len(files) > 1)} passed over ({listed(sorted(files), 3)}): {remedy}"
        for (name, remedy), files in sorted(of_format.items())
    ]


def class_counts(config: Mapping[str, Any], source: Source) -> dict[str, Count]:
    """The number of objects, or "all", of each class that a checked config asks for, in its order. Raises `ConfigError`
    for a class that is listed twice, and `CatalogueError` as `all_classes` does."""
    if config["classes"] == "all":
        return all_classes(source)
    rows = [(normalize("NFC", row["class"]), row["objects"]) for row in config["classes"]]
    if twice := [name for name, count in Counter(name for name, _ in rows).items() if count > 1]:
        raise ConfigError(
            f"config classes: {', '.join(twice)} listed more than once: keep one entry of each class, "
            "with the number of objects that it shall have"
        )
    return dict(rows)


def _no_mesh(source: Source) -> str:
    """The message about a source in which no mesh is found."""
    message = f"{source.path}: no mesh found for {' or '.join(source.patterns)}"
    if not source.pattern:
        return f"{message}: expected files {', '.join(MESH_SUFFIXES)}"
    inner = "" if "{class}" in source.pattern else " (patterns begin at source.path; `{class}/...` has classes)"
    return f"{message}: correct source.pattern{inner}"


def _candidates(source: Source, class_name: str | None, table: ObjectTable) -> list[SourceObject]:
    """The objects of a class, or of all, named by their paths, but for files that users exclude."""
    entries = _one_of_each(
        entry
        for pattern in source.patterns
        for entry in _of_pattern(source, pattern, class_name)
        if table.of(entry.source, "").exclude != "yes"
    )
    by_class, place = source.has_class_folders, Path(source.path)
    if not source.pattern and "*" not in source.patterns[0].split("/")[-1] and (class_name or not by_class):
        place /= source.folder_of(class_name) if by_class and class_name else ""
        without = set(subfolders(place)) - {entry.object for entry in entries} if place.is_dir() else ()
        if without:  # of the objects' folders of a published layout
            log.warning("%s: no mesh in %d models: %s", place, len(without), listed(sorted(without)))
    if source.kind != "folder":
        return entries
    # Named by their folders where a file's name says nothing: `003_can/textured`, alone there.
    steps = [(entry, [entry.class_name, *entry.object.split("/")]) for entry in entries]
    below = Counter(tuple(path[:end]) for _, path in steps for end in range(2, len(path) + 1))
    for _, path in steps:
        while len(path) > 2 and is_general(path[-1]) and below[tuple(path[:-1])] == 1:
            path.pop()
    return [entry._replace(object="/".join(path[1:])) for entry, path in steps]


def _of_pattern(source: Source, pattern: str, class_name: str | None) -> Iterator[SourceObject]:
    """The mesh files that a pattern matches; class_name: of this class, or None for those of all."""
    root, steps = Path(source.path), pattern.split("/")
    if "{class}" in steps:
        of_class = _classes_by_folder(source, steps[: steps.index("{class}")], class_name)
    else:
        of_class = {"": class_name or ONE_CLASS}
    wild = [place for place, step in enumerate(steps) if glob.has_magic(step)] or [0, len(steps) - 1]
    after = len(steps) - 1 - wild[-1]  # fixed steps at the end
    for folder, name in sorted(of_class.items()):
        for file in sorted(_matches(root, pattern, folder)):
            parts = file.split("/")
            kept = "/".join(parts[wild[0] : len(parts) - after])
            yield SourceObject(kept if after else MESH_SUFFIX.sub("", kept), name, file)


def _classes_by_folder(source: Source, above: Sequence[str], class_name: str | None) -> dict[str, str]:
    """The class of each folder that is one's, or of those of one class, whose name macOS may have written otherwise;
    above: the steps of the pattern to these folders. Raises CatalogueError if a class has none."""
    root = Path(source.path)
    if class_name is None:
        places = sorted(glob.glob("/".join([*above, ""]), root_dir=root)) if above else [""]
        return {folder: source.class_of(folder) for place in places for folder in source.class_folders(root / place)}
    own, place = source.folder_of(class_name), root.joinpath(*above)
    forms = dict.fromkeys([own, *(normalize(form, own) for form in ("NFC", "NFD"))])
    same = [form for form in forms if glob.glob("/".join([*above, glob.escape(form), ""]), root_dir=root)]
    if not same and not any(map(glob.has_magic, above)):
        present = listed(source.class_folders(place)) if place.is_dir() else "nothing"
        raise CatalogueError(
            f"{place / own}: no such folder: the class {class_name} has its meshes there; {place} has {present}"
        )
    return dict.fromkeys(same, class_name)


def _matches(root: Path, pattern: str, folder: str) -> Iterator[str]:
    """Mesh files below the root that a pattern matches, of the class in this folder; hidden files and folders never."""
    pattern = pattern.replace("{class}", glob.escape(folder))
    above, deep, rest = pattern.partition("**")
    if deep:
        folders, rest = glob.iglob(above, root_dir=root) if above else [""], rest.lstrip("/")
        files = (folder + file for folder in folders for file in _each_mesh(root / folder))
        if rest:
            files = (file for file in files if PurePosixPath(file).match(rest))  # by its last parts
    else:
        matches = (file for file in glob.iglob(pattern, root_dir=root) if MESH_SUFFIX.search(file))
        files = (file for file in matches if not (root / file).is_dir())
    return (file.encode("utf-8", "backslashreplace").decode() for file in files)  # see `named_files.unusable`


def _each_mesh(folder: Path, suffix: re.Pattern[str] = MESH_SUFFIX) -> Iterator[str]:
    """Mesh files, or those of other suffixes, at any depth. Links are followed, but to a folder around them."""

    def returns(below: Path) -> bool:
        """Whether a folder is a link to one that contains it: following it would never end."""
        above = (Path(os.path.realpath(each)) for each in below.parents if each == folder or folder in each.parents)
        return below.is_symlink() and any(parent.is_relative_to(os.path.realpath(below)) for parent in above)

    for place, folders, files in os.walk(folder, followlinks=True):
        folders[:] = [name for name in folders if not name.startswith(".") and not returns(Path(place, name))]
        within = Path(place).relative_to(folder).as_posix()  # once a folder: there may be 100,000 files
        for name in files:
            if suffix.search(name) and not name.startswith("."):
                yield name if within == "." else f"{within}/{name}"


def _one_of_each(entries: Iterable[SourceObject]) -> list[SourceObject]:
    """One entry for all files that show one object (`palpate.catalogue.variants`): of the best, by `PREFERENCE`, one.
    Of a layout's patterns that end with a file's name, the first that matches counts."""
    groups: dict[tuple[str, ...], list[SourceObject]] = {}
    for entry in entries:
        is_named_by_file = MESH_SUFFIX.sub("", entry.source).endswith(entry.object)
        groups.setdefault((entry.class_name, *([] if is_named_by_file else [entry.object])), []).append(entry)
    chosen = []
    for (_, *name), group in groups.items():
        objects: Iterable[Iterable[int]] = [range(len(group))]
        if not name:
            group.sort(key=lambda entry: PREFERENCE.index(os.path.splitext(entry.source)[1].lower()))
            objects = of_one_object([entry.object for entry in group])
        for best, *others in objects:
            chosen.append(group[best]._replace(others=tuple(sorted(group[other].source for other in others))))
    return chosen


def _by_class(source: Source, table: ObjectTable) -> dict[str, list[SourceObject]]:
    """The objects of each class, after what users say of classes."""
    by_class: dict[str, list[SourceObject]] = {}
    for entry in _released(source) if source.kind == "released" else _candidates(source, None, table):
        name = table.of(entry.source, entry.class_name).class_name
        by_class.setdefault(name, []).append(entry._replace(class_name=name))
    return by_class


def _described(entry: SourceObject, table: ObjectTable, source: Source) -> SourceObject:
    """An object with its own name, up axis, scale and split."""
    given, path = table.of(entry.source, entry.class_name), Path(source.path, entry.source)
    up, suffix = given.up or source.up, path.suffix.lower()
    if up == "format":
        up = FORMAT_UP.get(suffix, "y" if suffix == ".dae" else "z")
        if suffix == ".dae" and not unusable(path):
            with open(path, "rb") as file:
                axis = re.search(rb"<up_axis>\s*([XYZ])_UP", file.read(HEAD))  # at its top
            up = axis[1].decode().lower() if axis else up
    return entry._replace(
        object=_object(entry.class_name, entry.object),
        up=up,
        scale=float(given.scale) if given.scale[:1].isdigit() else given.scale or source.scale,
        split=given.split or entry.split,
    )


def _turned(source: Source, entries: Iterable[SourceObject]) -> list[SourceObject]:
    """The entries, each with an angle of its own where the source is turned: it depends on seed and name only."""
    if not source.turned:
        return list(entries)
    angles = ((entry, generator(source.seed, entry.object, "turn").uniform(0, 360)) for entry in entries)
    return [entry._replace(turn=round(angle, 2)) for entry, angle in angles]


def _procedural(source: Source, name: str, count: Count) -> Iterable[SourceObject]:
    """The first objects of a procedural class."""
    if name not in shapes.CLASSES:
        raise CatalogueError(f"class {name}: the procedural classes are {', '.join(shapes.CLASSES)}")
    if not isinstance(count, int):
        raise CatalogueError(f"class {name}: procedural objects have no end: ask for a number, not for `all`")
    for index in range(count):
        own = f"{name}-{index:04d}"
        yield SourceObject(own, name, f"{name}/{own}{shapes.suffix(index)}", source.up, source.scale)


def _released(source: Source) -> list[SourceObject]:
    """All objects of a released dataset, named as there. Raises CatalogueError if it can't be read."""
    try:
        splits = read_released(source.path)
    except UnusableObject as error:
        raise CatalogueError(str(error)) from None
    return [SourceObject(Path(own).stem, Path(own).parent.name, own, split=split) for own, split in splits.items()]


@cache
def file_name(class_name: str) -> str:
    """A class's name as a part of file names: spaces are `_`, and then as `_safe`."""
    return _safe(normalize("NFC", class_name).replace(" ", "_"), class_name)


def _object(class_name: str, path: str) -> str:
    """The object's name: class and path, folders joined by '-'; what repeats the part before it is left out."""
    path = normalize("NFC", path)
    parts = [class_name, *path.split("/")]
    kept = [part for before, part in zip(parts, parts[1:], strict=False) if part != before]
    return _safe("-".join([file_name(class_name), *kept]), path)


def _safe(text: str, origin: str) -> str:
    """A text as a file's name. Other characters than letters, digits, `_`, `.` and `-` are `_`, and what is too long is
    cut off. A hash of its origin follows then, so that different files keep different names."""
    safe = re.sub(rf"[^{LETTERS}.-]", "_", text)
    if len(safe.encode()) > LONGEST_NAME:
        safe = safe.encode()[: LONGEST_NAME - 9].decode(errors="ignore")
    return safe if safe == text else f"{safe}-{_hash(origin)}"


def _hash(text: str) -> str:
    """Eight digits that tell texts apart."""
    return hashlib.sha256(text.encode()).hexdigest()[:8]


def _distinct(entries: list[SourceObject]) -> list[SourceObject]:
    """The entries, with a hash of the file at the end of each name that one before it has already."""
    taken: dict[str, SourceObject] = {}
    for entry in entries:
        if entry.object in taken:
            name = f"{entry.object}-{_hash(entry.source)}"
            log.warning("%s: the name %s is another object's: called %s", entry.source, entry.object, name)
            entry = entry._replace(object=name)
        taken[entry.object] = entry
    return list(taken.values())


def _chosen(entries: list[SourceObject], folder: Path, name: str, count: Count) -> list[SourceObject]:
    """`count` of the entries, by name; CatalogueError if there are fewer. Of two with one name the one in fewer
    folders keeps it."""
    if not entries:
        raise CatalogueError(f"{folder}: no mesh found for class {name}: expected files {', '.join(MESH_SUFFIXES)}")
    entries = _distinct(sorted(entries, key=lambda entry: (entry.source.count("/"), entry.source)))
    if isinstance(count, int):
        if len(entries) < count:
            raise CatalogueError(
                f"{folder}: {len(entries)} meshes of class {name}, the config asks for {count}: add meshes, "
                f"or ask for {len(entries)} or `all`"
            )
        entries = sorted(entries, key=lambda entry: hashlib.sha256(entry.object.encode()).digest())[:count]
    return sorted(entries)


def listed(names: Iterable[str], most: int = 10) -> str:
    """The first few of some names, as messages have them."""
    names = list(names)
    return (", ".join(names[:most]) or "nothing") + (", ..." if len(names) > most else "")
