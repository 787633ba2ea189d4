"""Files that show one object: textured and plain, simplified, as collision hulls, in several formats.

mug/textured.obj  mug/collision.obj  mug/visual.ply       one object, taken from textured.obj
mug.obj  mug_vhacd.obj  mug_low.stl                       one object, taken from mug.obj
visual/mug.dae  collision/mug.stl                         one object, taken from visual/mug.dae
"""

import os
import re
from collections import defaultdict
from collections.abc import Iterable, Sequence

# Words in names of files that say which view of an object a file has, by how much it is the object as it looks.
VISUAL, WHOLE, SIMPLIFIED, COLLISION = range(4)
WORDS = {
    VISUAL: "textured texture visuals? vis render(ed)? colou?red",
    WHOLE: "models? mesh(es)? object scan original normali[sz]ed full raw high lod0 res poly",
    SIMPLIFIED: r"non.?textured untextured simplified simple decimated decim low reduced watertight lod\d+",
    COLLISION: "collisions? collider coll? convex hulls? v.?hacd coacd decomp(osed|osition)? phys(ics)?",
}
# These words may also be part of an object's name (a low table, the hull of a boat). They count only where another file
# has the name without them.
AMBIGUOUS = re.compile(r"models?|mesh(es)?|object|scan|full|raw|high|low|simple|convex|hulls?|col|vis|res|poly", re.I)
_WORD = "|".join(f"(?P<w{rank}>{'|'.join(words.split())})" for rank, words in WORDS.items())
_LAST = re.compile(rf"(?:^|[-_. ]+|(?<=[a-z])(?=[A-Z]))(?i:{_WORD})(?P<number>[-_. ]*\d+)?$")
_FIRST = re.compile(r"^(?i:(?P<w0>textured|visual)|(?P<w3>collision|v.?hacd|coacd))[-_. ]+(?=.)")


def variant(path: str) -> tuple[tuple[str, ...], int, bool]:
    """What a path without its suffix says of the file: its object, the folders and stem without `WORDS` (the stem is
    empty if there is nothing else); its rank; whether it has none of them, or one that is not `AMBIGUOUS`."""
    *folders, stem = path.split("/")
    stem, ranks, sure = _strip(stem)
    kept = []
    for folder in folders:
        rest, of_folder, _ = _strip(folder)
        if rest or {VISUAL, COLLISION}.isdisjoint(of_folder):
            kept.append(folder)
        else:
            ranks, sure = ranks + of_folder, True
    worst = max(ranks, default=WHOLE)
    stem = "" if kept and stem == kept[-1] else stem
    return (*kept, stem), worst if worst > WHOLE else min(ranks, default=WHOLE), sure or not ranks


def _strip(stem: str) -> tuple[str, list[int], bool]:
    """A stem without `WORDS`, the ranks of these, and whether one of them is not `AMBIGUOUS`."""
    ranks, sure = [], False
    while match := _LAST.search(stem) or _FIRST.search(stem):
        (rank, word) = next((rank, match[f"w{rank}"]) for rank in WORDS if match.groupdict().get(f"w{rank}"))
        if match.groupdict().get("number") and rank != COLLISION:
            break  # mesh_1 and mesh_2 are two objects; hulls are numbered
        sure |= not AMBIGUOUS.fullmatch(word)
        ranks.append(rank)
        stem = stem[: match.start()] + stem[match.end() :]
    return stem, ranks, sure


def is_general(name: str) -> bool:
    """Whether the name of a folder or a file, without suffix, says nothing of the object: `textured`, `meshes`."""
    return not _strip(name)[0]


def is_collision(path: str) -> bool:
    """Whether a mesh file is one to collide with, by its name or a folder's."""
    return variant(os.path.splitext(path)[0])[1] == COLLISION


def of_one_object(paths: Sequence[str]) -> Iterable[list[int]]:
    """Positions of the paths, without suffixes, of each object, the best of `WORDS` first."""
    objects, ranks, is_sure = zip(*map(variant, paths), strict=True)
    sure = {key for key, is_so in zip(objects, is_sure, strict=True) if is_so}
    groups, in_folder = defaultdict(list), defaultdict(set)
    for position, key in enumerate(objects):
        key = key if key in sure or not key[-1] else tuple(paths[position].split("/"))
        groups[key].append(position)
        in_folder[key[:-1]].add(key)
    for folder, keys in in_folder.items():  # hulls that are named for nothing, beside one object
        hulls = (*folder, "")
        if hulls in sure and len(keys) == 2 and all(ranks[hull] == COLLISION for hull in groups[hulls]):
            (other,) = keys - {hulls}
            groups[other] += groups.pop(hulls)
    return (sorted(group, key=ranks.__getitem__) for group in groups.values())
