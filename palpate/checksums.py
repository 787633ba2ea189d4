"""What files held when they were written: sizes and checksums, to tell lost, cut and altered files from whole ones.

A folder of many files carries `manifest.json`. A table or a record carries `.<name>.sha256` beside it, which
`sha256sum --check` reads too. Stores of a batch carry theirs within (`palpate.store.files`).

SHA-256 and no CRC: chunks of Zarr end with their CRC-32C, so that of the whole file is the same whatever it holds.
"""

import csv
import hashlib
import io
import json
import os
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path

MANIFEST = "manifest.json"
Manifest = Mapping[str, Sequence]  # path from the folder on -> number of bytes, SHA-256


class DamagedFile(ValueError):
    """A file is missing or not as it was written; the message names it and the remedy.

    A file that may not be read is not damaged: whatever reads here raises PermissionError as it comes.
    """


def size_and_sha256(path: Path | str) -> list:
    """Number of bytes and SHA-256 of a file."""
    with open(path, "rb", buffering=0) as file:
        return [os.fstat(file.fileno()).st_size, hashlib.file_digest(file, "sha256").hexdigest()]


def manifest_of(folder: Path | str) -> dict[str, list]:
    """The manifest of all files in a folder but its own `manifest.json` and hidden ones (Snakemake's), in order."""
    folder = Path(folder)
    files = sorted(path for path in folder.rglob("[!.]*") if path.is_file() and path != folder / MANIFEST)
    return {path.relative_to(folder).as_posix(): size_and_sha256(path) for path in files}


def write_manifest(folder: Path | str) -> None:
    """Write a folder's `manifest.json`, when all its files are there."""
    (Path(folder) / MANIFEST).write_text(json.dumps(manifest_of(folder), indent=0) + "\n")


def read_manifest(folder: Path | str, remedy: str) -> dict[str, list]:
    """A folder's `manifest.json`. Raises DamagedFile if it is missing or can't be read."""
    path = Path(folder) / MANIFEST
    try:
        found = json.loads(path.read_bytes())
        return {name: [int(size), str(digest)] for name, (size, digest) in found.items()}
    except FileNotFoundError:
        raise DamagedFile(f"{path} does not exist, so what {folder} should hold is unknown; {remedy}") from None
    except PermissionError:
        raise
    except (OSError, ValueError, AttributeError, TypeError) as error:
        raise DamagedFile(f"{path} can't be read ({type(error).__name__}); {remedy}") from None


def find_damage(folder: Path | str, files: Manifest, contents: bool = False) -> list[str]:
    """What is wrong with a folder's files by a manifest, one line a file: "visual.glb is missing".

    contents: compare checksums too, which reads every file; else existence and sizes only.
    """
    lines = (_difference(os.path.join(folder, name), expected, contents) for name, expected in files.items())
    return [f"{name} {line}" for name, line in zip(files, lines, strict=True) if line]


def _difference(path: str, expected: Sequence, contents: bool) -> str:
    """How a file differs from what was written; empty if it does not."""
    try:
        size = os.stat(path).st_size
        if size == expected[0] and contents:
            size, digest = size_and_sha256(path)
            if digest != expected[1]:
                return "has changed since it was written (checksum)"
    except (FileNotFoundError, NotADirectoryError):
        return "is missing"
    except PermissionError:  # nothing is known of the file
        raise
    except OSError as error:
        return f"can't be read ({error.strerror})"
    return "" if size == expected[0] else f"has {size} bytes, but {expected[0]} were written"


def join_first(lines: Iterable[str], most: int = 3) -> str:
    """The first few of some lines in one, and how many more there are."""
    lines = list(lines)
    return "; ".join([*lines[:most], *([f"and {len(lines) - most} more"] if len(lines) > most else [])])


def sidecar(path: Path | str) -> Path:
    """Where the checksum of a single file is kept."""
    path = Path(path)
    return path.with_name(f".{path.name}.sha256")


def write_sidecar(path: Path | str) -> None:
    """Write the checksum of a single file beside it, as `sha256sum` does."""
    sidecar(path).write_text(f"{size_and_sha256(path)[1]}  {Path(path).name}\n")


def changed(folder: Path | str) -> list[Path]:
    """Files in a folder, and in folders below, that are not those that the checksums beside them are of.

    Stores and folders with a manifest are passed over, and so are hidden folders. A file that was removed is no
    finding: it is built again.
    """
    found = []
    for place, folders, files in os.walk(folder):
        passed_over = MANIFEST in files
        folders[:] = [] if passed_over else sorted(x for x in folders if not x.startswith(".") and ".zarr" not in x)
        for path in (Path(place, name) for name in sorted(files)):
            stated = sidecar(path)
            if stated.name in files and stated.read_bytes()[:64] != size_and_sha256(path)[1].encode():
                found.append(path)
    return found


def read_text(path: Path | str, remedy: str) -> str:
    """The text of a table or record that a run wrote.

    A file without a checksum beside it, written by hand or by another program, is taken as it is.
    Raises DamagedFile if the file is missing, empty, not UTF-8, not the one that its checksum is of, or a table without
    a line break at its end.
    """
    path = Path(path)
    try:
        data = path.read_bytes()
    except (FileNotFoundError, NotADirectoryError):
        raise DamagedFile(f"{path} does not exist; {remedy}") from None
    except PermissionError:
        raise
    except OSError as error:
        raise DamagedFile(f"{path} can't be read ({error.strerror}); {remedy}") from None
    if not data.strip():
        raise DamagedFile(f"{path} is empty; {remedy}")
    try:
        text = data.decode("utf-8")
    except UnicodeDecodeError:
        raise DamagedFile(f"{path} is not text; {remedy}") from None
    if "\0" in text:
        raise DamagedFile(f"{path} is not text; {remedy}")
    if path.suffix == ".csv" and not text.endswith("\n"):  # a record that is cut off is not valid JSON
        raise DamagedFile(f"{path} is cut off: no line break at its end; {remedy}")
    try:
        expected = sidecar(path).read_bytes()
    except FileNotFoundError:
        return text
    if expected[:64] != hashlib.sha256(data).hexdigest().encode():
        raise DamagedFile(
            f"{path} has changed since it was written ({sidecar(path).name} has another checksum); {remedy}, "
            f"or remove {sidecar(path).name} if the change is yours"
        )
    return text


def read_rows(path: Path | str, columns: Iterable[str], remedy: str) -> list[dict[str, str]]:
    """Rows of a CSV table that a run wrote: values by column.

    Raises DamagedFile as `read_text` does, and if a column is missing or a line has more or fewer values than the
    first.
    """
    lines = csv.DictReader(io.StringIO(read_text(path, remedy), newline=""), strict=True)
    try:
        rows = list(lines)
    except csv.Error as error:
        raise DamagedFile(f"{path} is not a valid CSV file ({error}); {remedy}") from None
    if missing := [name for name in columns if name not in (lines.fieldnames or ())]:
        raise DamagedFile(f"{path} has no column {missing[0]!r}; {remedy}")
    for number, row in enumerate(rows, start=1):
        if None in row or None in row.values():
            raise DamagedFile(f"{path} lacks a value, or has one too many, in row {number}; {remedy}")
    return rows


def read_record(path: Path | str, remedy: str) -> dict:
    """The JSON object of a record that a run wrote. Raises DamagedFile as `read_text` does, and for other JSON."""
    try:
        record = json.loads(read_text(path, remedy))
    except json.JSONDecodeError as error:
        raise DamagedFile(f"{path} is not valid JSON ({error}); {remedy}") from None
    if not isinstance(record, dict):
        raise DamagedFile(f"{path} is not a JSON object; {remedy}")
    return record
