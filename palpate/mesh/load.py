"""Reading a mesh file of any supported format: its parts, with their materials."""

from pathlib import Path

from palpate.batch import UnusableObject
from palpate.mesh import FORMATS
from palpate.mesh.formats import collada, gltf, obj, off, ply, stl, threemf
from palpate.mesh.part import Files, Loaded
from palpate.named_files import UNREAD, unusable, what_it_is

# Imported with this module: objects are read in processes of their own, which would each import them.
READERS = {"obj": obj, "glb": gltf, "gltf": gltf, "stl": stl, "ply": ply, "off": off, "dae": collada, "3mf": threemf}


def load(path: Path | str, root: Path | str | None = None) -> tuple[Loaded, dict[str, str]]:
    """Every triangle mesh of a file, placed as the file says, nothing repaired, and what is wrong with files and parts
    that it names (in root, as for `palpate.named_files.find`), by name. Raises `UnusableObject` if it can't be read,
    has no triangles, or lacks vertices; MemoryError, naming the file."""
    path = Path(path)
    suffix = path.suffix.lower()
    kind = suffix.removeprefix(".")
    if suffix in UNREAD:
        raise UnusableObject("{}: {}: {}".format(path, *UNREAD[suffix]))
    if kind not in FORMATS:
        raise UnusableObject(f"{path}: a mesh file ends in one of .{', .'.join(FORMATS)}: convert it to one of these")
    if problem := unusable(path):
        raise UnusableObject(f"{path}: {problem}")
    if not path.is_file():
        raise UnusableObject(f"{path}: there is no such file: correct the path or remove the object")
    if other := what_it_is(path):
        raise UnusableObject(f"{path}: can't be read as {suffix}: {other}")
    files = Files(path, root)
    try:
        loaded = READERS[kind].read(path, files)
    except MemoryError as error:  # says nothing about the object
        raise MemoryError(f"while loading {path}, {path.stat().st_size / 1e6:.0f} MB {error}".strip()) from None
    except Exception as error:  # the readers raise whatever a broken file makes them trip over
        name = "" if isinstance(error, ValueError) else f"{type(error).__name__}: "
        raise UnusableObject(
            f"{path}: can't be read as {suffix} ({name}{error}): export it again, or remove the object"
        ) from error
    parts = [part for part in loaded.parts if len(part.faces)]
    if not parts:
        raise UnusableObject(f"{path}: holds no triangles (points or lines only, or nothing): export its faces")
    for part in parts:
        least, largest = part.faces.min(), part.faces.max()
        if least < 0 or largest >= len(part.vertices):
            raise UnusableObject(
                f"{path}: a face refers to vertex {least if least < 0 else largest} of {len(part.vertices)}: "
                "the file is damaged, export it again"
            )
    return Loaded(parts, loaded.unit), files.problems
