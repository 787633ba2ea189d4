"""Seals: what an output of a job holds and what it was made from, to tell lost, altered and outdated ones from others.

A seal is one JSON object:

    version      of seals
    files        path from the folder on, of a single file its name -> number of bytes, SHA-256
    made_from    {"inputs": {"touch/batch-0000.zarr": digest of its seal, ...}, "config": {"vision.size": 256, ...}}
    digest       SHA-256 of all of these

It is within the output where that has room, so that both are copied together: `seal.json` in a folder, the user block
of an HDF5 file, the comment of a checkpoint's ZIP archive. Else it is `.<name>.seal.json` beside the file. Nothing in
it depends on times, places or machines.
"""

import hashlib
import json
import os
import re
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import groupby
from pathlib import Path
from types import MappingProxyType
from typing import Any

from palpate.rebuild_command import is_of_run, label_of, rebuild_advice

VERSION = 1
NAME = "seal.json"
USER_BLOCK = 8192  # bytes before the content of an HDF5 file, which HDF5 skips
WITHIN = (".h5", ".ckpt")  # kinds of files that have their seal within
ZIP_END, ZIP_END_BYTES = b"PK\5\6", 22  # the record that ends a ZIP archive, before the comment
# Keys of the config that say where something is or how it is computed; what they name is in the contents.
NOT_CONTENT = ("device", "exr", "hand")
BATCH = re.compile(r"(?P<start>.*batch-)(?P<number>\d+)(?P<end>\D*)")
BATCHES = re.compile(r"(?P<start>.*)\{(?P<first>\d+)\.\.(?P<last>\d+)\}(?P<end>.*)")

Files = Mapping[str, Sequence[Any]]  # path from the folder on -> number of bytes, SHA-256
MadeFrom = Mapping[str, Mapping[str, Any]]
NOTHING: Mapping[str, Any] = MappingProxyType({})  # of what was made from no other output, and from no config
DigestOf = Callable[[str], str | None]  # the digest of an output, by its label; None where there is none


class DamagedFile(ValueError):
    """An output is missing or not as it was written; the message names it and the remedy.

    A file that may not be read is not damaged: whatever reads here raises PermissionError as it comes.
    """


class MixedInputs(ValueError):
    """Inputs of a job were not made from one another; the message names one and the remedy."""


@dataclass(frozen=True)
class Seal:
    """The seal of one output: `path`, what it holds (`files`), and what it was made from (`inputs`, `config`)."""

    path: Path
    files: Files
    inputs: Mapping[str, str]
    config: Mapping[str, Any]

    @property
    def made_from(self) -> dict[str, Any]:
        """Inputs and config, as `write` takes them."""
        return {"inputs": dict(self.inputs), "config": dict(self.config)} if self.inputs or self.config else {}

    @cached_property
    def digest(self) -> str:
        """SHA-256 of what the seal states: that of an output that holds or was made from anything else is another."""
        return hashlib.sha256(json.dumps([VERSION, self.files, self.made_from], sort_keys=True).encode()).hexdigest()

    @property
    def label(self) -> str:
        """The name by which other seals state this output: its path from the run's folder on."""
        return label_of(self.path)

    def damage(self, names: Iterable[str] | None = None, contents: bool = True) -> list[str]:
        """What is wrong with the files, or some of them, one line a file: "visual.glb is missing".

        contents: compare checksums too, which reads every file; else existence and sizes only.
        """
        folder = self.path if self.path.is_dir() else self.path.parent
        names = self.files if names is None else names
        lines = ((name, _difference(os.path.join(folder, name), self.files[name], contents)) for name in names)
        return [f"{name} {line}" for name, line in lines if line]

    def difference(self, config: Mapping[str, Any], digest_of: DigestOf) -> str:
        """How it was made otherwise than from a config (values by path) and outputs; empty if it was not.

        An output that there is none of does not count.
        """
        lines = [
            f"with {key} = {value}, but the run has {config[key]}"
            for key, value in self.config.items()
            if key in config and config[key] != value
        ]
        others = [label for label, digest in self.inputs.items() if digest_of(label) not in (None, digest)]
        lines += [f"from other {' and '.join(others[:3])} than the run has"] if others else []
        return join_first(lines)

    def refusal(self, difference: str) -> str:
        """The error message about a difference."""
        return f"{self.path} was made {difference}; {rebuild_advice(self.path)}"


def size_and_sha256(path: Path | str) -> list[Any]:
    """Number of bytes and SHA-256 of a file."""
    with open(path, "rb", buffering=0) as file:
        return [os.fstat(file.fileno()).st_size, hashlib.file_digest(file, "sha256").hexdigest()]


def measured(content: bytes) -> list[Any]:
    """Number of bytes and SHA-256 of what is in memory."""
    return [len(content), hashlib.sha256(content).hexdigest()]


def beside(path: Path) -> Path:
    """Where the seal is of a file that has no room for it."""
    return path.with_name(f".{path.name}.{NAME}")


def write(
    path: Path | str,
    made_from: MadeFrom = NOTHING,
    files: Files | None = None,
    name: str = "",
    place: Path | None = None,
) -> None:
    """Seal an output that is complete; a seal that it has is replaced.

    made_from: as `combine` and `made_of` return it. files: of a folder, where they are known. name, place: of a single
    file that is still at a temporary path, and where then to write a seal that does not fit within.
    """
    path = Path(path)
    if path.is_dir():
        if files is None:
            paths = sorted(each for each in path.rglob("[!.]*") if each.is_file() and each != path / NAME)
            files = {each.relative_to(path).as_posix(): size_and_sha256(each) for each in paths}
        (path / NAME).write_text(_text(files, made_from))
        return
    content, _ = _parts(path)
    text = _text({name or path.name: measured(content)}, made_from)
    if path.suffix == ".h5":
        with path.open("r+b") as file:
            file.write(_fitting(text, USER_BLOCK).ljust(USER_BLOCK))
    elif path.suffix == ".ckpt":
        comment = _fitting(text, 2**16 - 1)
        path.write_bytes(content + len(comment).to_bytes(2, "little") + comment)
    else:
        (place or beside(path)).write_text(text)


def text_of(path: Path) -> bytes:
    """The text of an output's seal, which no other output has. Raises OSError if there is none."""
    if path.suffix == ".h5":
        with path.open("rb", buffering=0) as file:
            return file.read(USER_BLOCK)
    if path.suffix == ".ckpt":
        return _parts(path)[1]
    return (path / NAME if path.is_dir() else beside(path)).read_bytes()


def read(path: Path | str, remedy: str = "") -> Seal:
    """The seal of an output. Raises DamagedFile if the output or its seal is missing, or the seal is not as written.

    remedy: the end of a message; by default how to build the output again.
    """
    path = Path(path)
    place = path / NAME if path.is_dir() else path if path.suffix in WITHIN else beside(path)
    try:
        stated = json.loads(text_of(path))
        if stated["version"] == VERSION:
            made_from = stated["made_from"]
            seal = Seal(path, stated["files"], made_from.get("inputs", {}), made_from.get("config", {}))
            if seal.digest == stated["digest"]:
                return seal
        problem = f"its seal ({place}) has changed since it was written, or is of another version of palpate"
    except FileNotFoundError:
        problem = f"it has no seal ({place})" if os.path.lexists(path) else ""
    except PermissionError:
        raise
    except (OSError, ValueError, LookupError, TypeError, AttributeError) as error:
        problem = f"its seal ({place}) can't be read ({type(error).__name__})"
    if not problem:
        raise DamagedFile(f"{path} does not exist; {remedy or rebuild_advice(path)}")
    raise DamagedFile(f"{path} is damaged, or of another version of palpate: {problem}; {remedy or _remedy(path)}")


def find(path: Path | str, remedy: str = "") -> Seal | None:
    """As `read`; None for a file without a seal beside it that is in no run's folder: written by hand, or a copy."""
    path = Path(path)
    plain = not path.is_dir() and path.suffix not in WITHIN and path.exists() and not beside(path).exists()
    if plain and not is_of_run(path):
        return None
    return read(path, remedy)


def verify(path: Path | str, remedy: str = "") -> Seal:
    """The seal of an output whose files are all as it states. Raises DamagedFile, naming the first that is not."""
    seal = read(path, remedy)
    require_whole(seal, remedy=remedy)
    return seal


def require_whole(seal: Seal, names: Iterable[str] | None = None, contents: bool = True, remedy: str = "") -> None:
    """Raise DamagedFile, naming the first, if files of an output are not as they were written: see `Seal.damage`."""
    if lines := seal.damage(names, contents):
        raise damaged(seal.path, lines, remedy)


def damaged(path: Path, lines: Iterable[str], remedy: str = "") -> DamagedFile:
    """The error about an output whose files are not as they were written; lines: what is wrong with which."""
    return DamagedFile(f"{path} is damaged: {join_first(lines)}; {remedy or _remedy(path)}")


def digest_in(run: Path, label: str) -> str | None:
    """The digest of an output, or of those of several batches, in a run's folder; None if one is missing or damaged."""
    digests = []
    for path in _expanded(label):
        try:
            digests.append(read(run / path).digest)
        except DamagedFile:
            return None
    return _joined(digests)


def by_path(config: Mapping[str, Any], prefix: str = "") -> dict[str, Any]:
    """Values of a nested config by their path, as `vision.size`, without those that do not count."""
    values: dict[str, Any] = {}
    for key, value in config.items():
        if isinstance(value, Mapping):
            values |= by_path(value, f"{prefix}{key}.") if key not in NOT_CONTENT else {}
        elif key not in NOT_CONTENT:
            values[f"{prefix}{key}"] = value
    return values


def combine(config: Mapping[str, Any], *inputs: Seal, more: Mapping[str, str] = NOTHING) -> dict[str, dict[str, Any]]:
    """What an output was made from, back to the source files: any two outputs of a batch can then be compared.

    config: the part of the config that its job uses, nested as there. inputs: what the job reads, each after those
    that it was made from. more: digests of further inputs. Raises MixedInputs if the inputs do not fit together.
    """
    values, contents = json.loads(json.dumps(by_path(config))), dict(more)
    for seal in inputs:
        if difference := seal.difference(values, contents.get):
            raise MixedInputs(seal.refusal(difference))
        values, contents = {**seal.config, **values}, {**seal.inputs, **contents, seal.label: seal.digest}
    return {"inputs": contents, "config": values}


def with_output(made_from: MadeFrom, path: Path | str) -> dict[str, dict[str, Any]]:
    """What an output was made from, and one more: a store states the rejections that its job wrote before it."""
    seal = read(path)
    inputs = {**made_from.get("inputs", {}), seal.label: seal.digest}
    return {"inputs": inputs, "config": dict(made_from.get("config", {}))}


def made_of(paths: Iterable[Path | str], config: Mapping[str, Any] = NOTHING) -> dict[str, dict[str, Any]]:
    """What an output of the whole run was made from: the outputs at these paths, but for those without a seal.

    config: values that its job uses, by their path. Batches in a row are one: `touch/batch-{0000..0012}.zarr`.
    """
    seals = [seal for seal in map(find, paths) if seal is not None]
    digests = {seal.label: seal.digest for seal in seals}
    inputs: dict[str, str] = {}

    def place(label: str) -> tuple[str, ...]:
        match = BATCH.fullmatch(label)
        return (match["start"], match["end"]) if match else (label,)

    for _, labels in groupby(sorted(digests, key=lambda label: (place(label), label)), place):
        for together in _in_a_row(list(labels)):
            first, last = (BATCH.fullmatch(label) for label in (together[0], together[-1]))
            label = together[0]
            if first and last and len(together) > 1:
                label = f"{first['start']}{{{first['number']}..{last['number']}}}{first['end']}"
            inputs[label] = _joined([digests[each] for each in together])
    return {"inputs": inputs, "config": json.loads(json.dumps(dict(config)))}


def join_first(lines: Iterable[str], most: int = 3) -> str:
    """The first few of some lines in one, and how many more there are."""
    lines = list(lines)
    return "; ".join([*lines[:most], *([f"and {len(lines) - most} more"] if len(lines) > most else [])])


def _in_a_row(labels: Sequence[str]) -> list[list[str]]:
    """Labels of batches of one stage, in parts whose numbers follow one another."""
    parts: list[list[str]] = []
    for label in labels:
        if parts and label == _next(parts[-1][-1]):
            parts[-1].append(label)
        else:
            parts.append([label])
    return parts


def _next(label: str) -> str:
    match = BATCH.fullmatch(label)
    number = f"{int(match['number']) + 1:0{len(match['number'])}d}" if match else ""
    return f"{match['start']}{number}{match['end']}" if match else ""


def _expanded(label: str) -> list[str]:
    """The paths that a label names, from the run's folder on."""
    match = BATCHES.fullmatch(label)
    if not match:
        return [label]
    numbers, digits = range(int(match["first"]), int(match["last"]) + 1), len(match["first"])
    return [f"{match['start']}{number:0{digits}d}{match['end']}" for number in numbers]


def _joined(digests: Sequence[str]) -> str:
    return digests[0] if len(digests) == 1 else hashlib.sha256("\n".join(digests).encode()).hexdigest()


def _text(files: Files, made_from: MadeFrom) -> str:
    made_from = json.loads(json.dumps(dict(made_from)))
    seal = Seal(Path(), files, made_from.get("inputs", {}), made_from.get("config", {}))
    stated = {"version": VERSION, "digest": seal.digest, "made_from": seal.made_from, "files": files}
    return json.dumps(stated)


def _fitting(text: str, most: int) -> bytes:
    data = text.encode()
    if len(data) > most:
        raise ValueError(f"a seal of {len(data)} bytes has no room in {most}")
    return data


def _parts(path: Path) -> tuple[bytes, bytes]:
    """What a file holds besides its seal, and the seal within it."""
    data = path.read_bytes()
    if path.suffix == ".h5":
        return data[USER_BLOCK:], data[:USER_BLOCK]
    if path.suffix == ".ckpt":
        end = data.rfind(ZIP_END) + ZIP_END_BYTES
        return data[: end - 2], data[end:] if int.from_bytes(data[end - 2 : end], "little") == len(data) - end else b""
    return data, b""


def _difference(path: str, expected: Sequence[Any], contents: bool) -> str:
    """How a file differs from what was written; empty if it does not."""
    try:
        if path.endswith(WITHIN):
            size, digest = measured(_parts(Path(path))[0])
        else:
            size, digest = os.stat(path).st_size, expected[1]
            if size == expected[0] and contents:
                size, digest = size_and_sha256(path)
    except (FileNotFoundError, NotADirectoryError):
        return "is missing"
    except PermissionError:  # nothing is known of the file
        raise
    except OSError as error:
        return f"can't be read ({error.strerror})"
    if size != expected[0]:
        return f"has {size} bytes, but {expected[0]} were written"
    return "" if digest == expected[1] else "has changed since it was written (checksum)"


def _remedy(path: Path) -> str:
    return rebuild_advice(path, str(path) if path.is_dir() else "it")
