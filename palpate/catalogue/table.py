"""The catalogue: one row an object, with its split, its batch and the checksum of what it is made from."""

import contextlib
import csv
import hashlib
import json
import os
import sys
from collections import Counter
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

from palpate import named_files, shapes
from palpate.atomic import atomic_write, write_if_changed
from palpate.catalogue.source import CatalogueError
from palpate.catalogue.sources import SourceObject, listed, style_of
from palpate.catalogue.split import SPLITS, assign_split, held_out_styles, suggest_split
from palpate.rebuild_command import rebuild_advice, rebuild_command, run_folder
from palpate.released import layout
from palpate.seal import NOTHING, DamagedFile, MadeFrom, size_and_sha256
from palpate.text_files import read_rows

COLUMNS = ("object", "class", "split", "batch", "source", "checksum", "up", "scale", "others", "turn", "style")
OTHERS = "; "
NAMED = 3  # groups of copies that a line names
ALIKE = 1e-4  # diagonals: of sides and root of the area, of objects that look like copies


class CatalogueEntry(NamedTuple):
    """One row of `catalogue.csv`; the fields are `COLUMNS`, in their order. A table may lack the later ones."""

    object: str
    class_name: str
    split: str
    batch: str
    source: str = ""  # its mesh file, relative to the source's path
    checksum: str = ""  # see `checksum`
    up: str = ""
    scale: str = ""
    others: str = ""  # further files of the object that are not used, separated by `OTHERS`
    turn: str = ""  # degrees about the vertical, empty for none
    style: str = ""  # of procedural ones

    @property
    def normalised(self) -> bool:
        """Whether the object was scaled to the one size of all, which is the default."""
        return self.scale in ("", "diagonal")


def _why_missing(path: Path) -> str:
    """The message about a table that does not exist: how to build it, or the runs that there are."""
    folder, run = path.parent, run_folder(path)
    if folder.exists() and not folder.is_dir():
        return f"{folder} is a file: name a run's folder"
    if path.name == "catalogue.csv" and run != folder.resolve() and (run / path.name).is_file():
        return f"{folder} is no run itself, but within the run {run}: name that"
    if folder.is_dir() and not any(folder.iterdir()):
        return f"{path} does not exist, and {folder} is empty: name a run's folder"
    place = folder if folder.is_dir() else folder.parent
    runs = sorted(catalogue.parent.name for catalogue in place.glob("*/catalogue.csv"))
    if folder.is_dir() and not runs:
        return f"{path} does not exist; name a run's folder, or build it with: {rebuild_command(path)}"
    known = f"runs in {place} are {', '.join(runs)}" if runs else f"there is no run in {place}"
    return f"{folder}: {'no run itself' if folder.is_dir() else 'no such run'}: {known}"


def read_catalogue(path: Path | str) -> list[CatalogueEntry]:
    """The rows of a `catalogue.csv`, or of one batch's, in their order. Raises CatalogueError, naming the file and the
    remedy, if it is missing, damaged, has no rows, or lacks a value of object, class or batch."""
    if not Path(path).is_file():
        raise CatalogueError(_why_missing(Path(path)))
    again = rebuild_advice(path)
    try:
        rows = read_rows(path, COLUMNS[:4])
    except DamagedFile as error:
        raise CatalogueError(str(error)) from None
    entries = [
        # Class, split and batch are one text for all rows that share them: a run may have 100,000 objects.
        CatalogueEntry(
            row["object"], *(sys.intern(row[key]) for key in COLUMNS[1:4]), *(row.get(key, "") for key in COLUMNS[4:])
        )
        for row in rows
    ]
    if not entries:
        raise CatalogueError(f"{path} lists no object; {again}")
    for number, entry in enumerate(entries, start=2):
        if "" in (entry.object, entry.class_name, entry.batch):
            raise CatalogueError(f"{path} lacks a value in line {number}; {again}")
    return entries


def splits_of(
    entries: Sequence[SourceObject] | Sequence[CatalogueEntry],
    ratios: Mapping[str, Any],
    seed: int = 0,
    groups: Iterable[Sequence[str]] = (),
) -> dict[str, str]:
    """The split of each object by name: that given by the source or the user, else by its name and the config's `split`
    (`fill`), or with `held_out: styles`, of procedural objects, by its style. groups: names of `copies`, which are
    in the split that one of them is given, or else in that of the first; several that are given stay."""
    given, of_class = ({entry.object: getattr(entry, key) for entry in entries} for key in ("split", "class_name"))
    shares = {split: ratios[split] for split in SPLITS}
    first = {name: name for name in given} | {name: group[0] for group in groups for name in group}
    splits = {first[name]: split for name, split in reversed(given.items()) if split}
    names = [name for name in given if first[name] == name and name not in splits]
    if ratios.get("held_out") == "styles":
        styles = {name: style_of(name, of_class[name], seed) for name in names}
        classes = {of_class[name] for name in names}
        unseen = {(name, style) for name in classes for style in held_out_styles(name, shapes.styles(name), shares)}
        for name, style in styles.items():
            held_out = (of_class[name], style) in unseen
            splits[name] = assign_split(name, shares | {"train": 0} if held_out else {"train": 1})
    else:
        filled = fill(shares, names, set(splits.values()))
        splits |= {name: assign_split(name, filled) for name in names}
    return {name: split or splits[first[name]] for name, split in given.items()}


def fill(ratios: Mapping[str, float], names: Sequence[str], given: Collection[str] = ()) -> Mapping[str, float]:
    """The ratios, or others, where names would leave a split empty: if they alone decide, those of `suggest_split`;
    else train alone, if none is there. given: splits that further objects are given."""
    filled = {assign_split(name, ratios) for name in names}
    if not names or min(ratios.values()) <= 0 or len(filled) > 2 or (given and "train" in filled | set(given)):
        return ratios
    return {"train": 1} if given else suggest_split(names) or ratios


def copies(checksums: Mapping[str, str], shapes: Mapping[str, Sequence[float]] | None = None) -> list[list[str]]:
    """Groups of objects, by name, of one checksum, or with boxes and areas that agree to `ALIKE`. checksums: of all
    objects, in order; an empty one tells nothing. shapes: of some, as `palpate.mesh.facts` has them."""
    import numpy as np
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components
    from scipy.spatial import cKDTree

    place = {name: number for number, name in enumerate(checksums)}
    first: dict[str, int] = {}
    pairs = [(number, first.setdefault(checksums[name] or name, number)) for name, number in place.items()]
    if shapes:
        rows = np.array([[*sorted(sides), area] for *sides, area in shapes.values()]).round(6)
        rows, one, which = np.unique(rows, axis=0, return_index=True, return_inverse=True)  # of many, few differ
        of_row = np.array([place[name] for name in shapes])
        alike = cKDTree(rows).query_pairs(ALIKE, output_type="ndarray")
        pairs += [*zip(of_row, of_row[one][which.ravel()], strict=True), *of_row[one][alike]]
    joined = coo_array((np.ones(len(pairs)), np.array(pairs).T), shape=(len(place), len(place)))
    groups: dict[int, list[str]] = {}
    for name, group in zip(place, connected_components(joined)[1], strict=True):
        groups.setdefault(group, []).append(name)
    return [group for group in groups.values() if len(group) > 1]


def copy_lines(
    groups: Iterable[Sequence[str]], checksums: Mapping[str, str], splits: Mapping[str, str]
) -> Iterator[str]:
    """Lines on objects that are there several times: first those in one split, then those in several. A line names the
    first groups only. groups: as `copies` gives them."""
    together: dict[str, list[str]] = {"in one split": [], "IN DIFFERENT SPLITS": []}
    for group in groups:
        place = "in one split" if len({splits[name] for name in group}) == 1 else "IN DIFFERENT SPLITS"
        sign = " = " if len({checksums[name] or name for name in group}) == 1 else " ~ "
        together[place].append(sign.join(group[: NAMED + 1]))
    for place, names in together.items():
        if names:
            verb = "object is" if len(names) == 1 else "objects are"
            signs = "(= the same files, ~ the same shape)"
            yield f"{len(names)} {verb} there several times, {place} {signs}: {listed(names, NAMED)}"


def check_splits(splits: Mapping[str, str], needed: Iterable[str], what: str, by_name: bool = True) -> None:
    """Raise CatalogueError if a split that is needed (by what, as the message names it) has none of the objects.
    splits: of each object. by_name: names decide the splits, so that the message can say how to set the config's."""
    counts = Counter(splits.values())
    empty = [split for split in needed if not counts[split]]
    if not empty:
        return
    message = (
        f"no object of this run is in the {' or '.join(empty)} split, which {what} needs "
        f"({', '.join(f'{split} {counts[split]}' for split in SPLITS)}): "
    )
    if by_name and len(splits) >= len(SPLITS) and (better := suggest_split(splits)):
        text = ", ".join(f"{split}: {share}" for split, share in better.items())
        raise CatalogueError(f"{message}set `split: {{{text}}}` in the config, or add objects (`classes`)")
    raise CatalogueError(f"{message}add objects (`classes`), or put some into it where the splits are given")


def build(
    root: Path | str, entries: Iterable[SourceObject], batches: Mapping[str, str], seed: int | None = None
) -> list[CatalogueEntry]:
    """The rows of some objects, in their order. root: the source's path. batches: of each object by name. seed: of
    procedural objects, which have styles. Raises `CatalogueError` if a mesh file does not exist."""
    return [
        CatalogueEntry(
            *(entry.object, entry.class_name, entry.split, batches[entry.object], entry.source),
            *(checksum(Path(root, entry.source), root), entry.up, str(entry.scale), OTHERS.join(entry.others)),
            *(str(entry.turn or ""), "" if seed is None else style_of(entry.object, entry.class_name, seed)),
        )
        for entry in entries
    ]


def write_catalogue(path: Path | str, entries: Iterable[CatalogueEntry], made_from: MadeFrom = NOTHING) -> None:
    """Write the rows of a `catalogue.csv`, and its seal with what they were made from."""
    with atomic_write(path, made_from) as partial, partial.open("w", newline="", encoding="utf-8") as file:
        csv.writer(file, lineterminator="\n").writerows([COLUMNS, *entries])


def companions(path: Path, root: Path | str | None = None, head: int = -1) -> list[str]:
    """The files of `palpate.named_files.companions`; of a released surface the object's images and scenes."""
    if path.suffix.lower() == ".npy":
        return layout.files(path)
    return named_files.companions(path, root, head)


def checksum(path: Path, files: Path | str | None = None) -> str:
    """SHA-256 of a mesh file, as `sha256sum` gives it; where the file names others (`companions`), that of the lines
    `<sha256>` of them all, the mesh first, the others by name. No name counts, so that copies have one checksum. files:
    the folder that these have to be in, as for `palpate.named_files.find`. Empty for what can't be a mesh
    file. Raises CatalogueError for a missing one."""
    if named_files.unusable(path):
        return ""
    if not path.is_file():
        raise CatalogueError(f"{path}: no such file, though the source lists it: was it moved, or not yet written?")
    own, *others = (size_and_sha256(path.parent / name)[1] for name in (path.name, *companions(path, files)))
    return hashlib.sha256("\n".join([own, *others, ""]).encode()).hexdigest() if others else own


def is_unchanged(path: Path, before: str, files: Path | str | None = None) -> bool:
    """Whether a source file is still the one of this `checksum`; False too if it can't be read."""
    try:
        return checksum(path, files) == before
    except (CatalogueError, OSError):
        return False


def require_unchanged(path: Path, before: str, files: Path | str | None = None) -> None:
    """Raise `palpate.seal.DamagedFile` if a source file is not the one of this `checksum` any more."""
    if not is_unchanged(path, before, files):
        raise DamagedFile(f"{path} has changed while it was read (checksum): start again once it is written")


def sources_of(entries: Iterable[CatalogueEntry]) -> dict[str, str]:
    """What a batch's meshes state of their source files: one digest of name, checksum, up axis, scale and turn of all;
    empty if the catalogue does not state checksums."""
    entries = list(entries)
    if not any(entry.checksum for entry in entries):
        return {}
    rows = [[each.object, each.checksum, each.up, each.scale, *filter(None, [each.turn])] for each in entries]
    digest = hashlib.sha256(json.dumps(rows).encode()).hexdigest()
    return {f"sources of {entries[0].batch}": digest}


def mesh_files(path: Path, root: Path | str) -> list[Path]:
    """A mesh file with the materials, textures and buffers that it names; empty for what can't be a mesh's file. Of a
    long OBJ only the head is read for them, at every start; the catalogue's checksums read all of it."""
    if named_files.unusable(path):
        return []
    return [path, *(Path(os.path.normpath(path.parent / name)) for name in companions(path, root, named_files.HEAD))]


def source_checksums(known: Path, files: Mapping[str, Sequence[Path]], root: Path | str) -> dict[str, str]:
    """The `checksum` of each object by name; empty for a file that is missing, or can't be a mesh's. known: a file that
    keeps sizes and times of each object's files, and their checksum: only files with others are read again. files: of
    each object, as `mesh_files` has them. root: of the sources."""
    try:
        before = json.loads(known.read_text())
    except (OSError, ValueError):
        before = {}
    now = {}
    for name, paths in files.items():
        stats = [path.stat() for path in paths if path.exists()]
        stamps = [[stat.st_size, stat.st_mtime_ns, stat.st_ctime_ns] for stat in stats]  # no copy keeps the last
        now[name] = before.get(name, [])
        if now[name][:1] != [stamps]:
            now[name] = [stamps, ""]
            with contextlib.suppress(CatalogueError, OSError, IndexError):
                now[name][1] = checksum(paths[0], root)
    with contextlib.suppress(OSError):  # a dry run on a folder of somebody else's
        write_if_changed(known, json.dumps(now) + "\n")
    return {name: digest for name, (_, digest) in now.items()}
