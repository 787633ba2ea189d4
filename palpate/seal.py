"""Seals: what an output of a job holds and what it was made from, to tell lost, altered and outdated ones from others.
A seal is one JSON object:

    version      of seals
    files        path from the folder on, of a single file its name -> number of bytes, SHA-256
    made_from    {"inputs": {"touch/batch-0000.zarr": digest of its seal, ...}, "config": {"vision.size": 256, ...}}
    digest       SHA-256 of all of these

It is within the output where that has room, so that both are copied together: `seal.json` in a folder, the user block
of an HDF5 file, the comment of a checkpoint's ZIP archive. Else it is `.<name>.seal.json` beside the file. Nothing in
it depends on times, places or machines."""

import hashlib
import json
import os
import re
from collections import defaultdict
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from types import MappingProxyType
from typing import Any

from palpate.rebuild_command import is_of_run, label_of, rebuild_advice

VERSION = 1
NAME = "seal.json"
USER_BLOCK = 8192  # bytes before the content of an HDF5 file, which HDF5 skips
WITHIN = {".h5": USER_BLOCK, ".ckpt": 2**16 - 1}  # kinds of files that have their seal within: bytes of room
ZIP_END, ZIP_END_BYTES = b"PK\5\6", 22  # the record that ends a ZIP archive, before the comment
# Keys of the config that say where something is or how it is computed; what they name is in the contents.
NOT_CONTENT = ("device", "exr", "hand")
BATCHES = re.compile(r"(.*/batch-)(\d+|\{[\d,]+\})(\D*)")  # labels: one batch, or several as `batch-{0000,0002}.zarr`

Files = Mapping[str, Sequence[Any]]  # path from the folder on -> number of bytes, SHA-256
MadeFrom = Mapping[str, Mapping[str, Any]]
NOTHING: Mapping[str, Any] = MappingProxyType({})  # of what was made from no other output, and from no config
DigestOf = Callable[[str], str | None]  # the digest of an output, by its label; None where there is none


class DamagedFile(ValueError):
    """An output is missing or not as it was written; the message names it and the remedy. A file that may not be read
    is not damaged: whatever reads here raises PermissionError as it comes."""


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
        return {"inputs": dict(self.inputs), "config": dict(self.config)} if self.inputs or self.config else {}

    @cached_property
    def digest(self) -> str:
        """SHA-256 of what the seal states: that of an output that holds or was made from anything else is another."""
        return hashlib.sha256(json.dumps([VERSION, self.files, self.made_from], sort_keys=True).encode()).hexdigest()

    @property
    def label(self) -> str:  # the name by which other seals state this output
        return label_of(self.path)

    def require(self, names: Iterable[str] | None = None, contents: bool = True) -> None:
        """Raise DamagedFile if files, or some of them, are not as they were written. It names the first, and says what
        is wrong: "visual.glb is missing". contents: compare checksums too, which reads every file; else existence and
        sizes only."""
        folder = self.path if self.path.is_dir() else self.path.parent
        names = self.files if names is None else names
        lines = ((name, _difference(os.path.join(folder, name), self.files[name], contents)) for name in names)
        if wrong := [f"{name} {line}" for name, line in lines if line]:
            raise damaged(self.path, join_first(wrong))

    def difference(self, config: Mapping[str, Any], digest_of: DigestOf) -> str:
        """How it was made otherwise than from a config (values by path) and outputs; empty if it was not. An output
        that there is none of does not count."""
        different = [key for key, value in self.config.items() if key in config and config[key] != value]
        lines = [f"with {key} = {self.config[key]}, but the run has {config[key]}" for key in different]
        others = [label for label, digest in self.inputs.items() if digest_of(label) not in (None, digest)]
        others = [re.sub(r"\{(\d+),.*?(\d+)\}", r"{\1..\2}", label) for label in others[:3]]
        lines += [f"from other {' and '.join(others)} than the run has"] if others else []
        return join_first(lines)

    def refusal(self, difference: str) -> str:
        return f"{self.path} was made {difference}; {rebuild_advice(self.path)}"


def size_and_sha256(path: Path | str) -> list[Any]:
    """Number of bytes and SHA-256 of a file."""
    with open(path, "rb", buffering=0) as file:
        return [os.fstat(file.fileno()).st_size, hashlib.file_digest(file, "sha256").hexdigest()]


def measured(content: bytes) -> list[Any]:
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
    file that is still at a temporary path, and where then to write a seal that does not fit within."""
    path = Path(path)
    if path.is_dir():
        if files is None:
            paths = sorted(each for each in path.rglob("[!.]*") if each.is_file() and each != path / NAME)
            files = {each.relative_to(path).as_posix(): size_and_sha256(each) for each in paths}
        (path / NAME).write_bytes(_text(files, made_from))
        return
    content, _ = _parts(path)
    text = _text({name or path.name: measured(content)}, made_from)
    if len(text) > WITHIN.get(path.suffix, len(text)):
        raise ValueError(f"{path}: a seal of {len(text)} bytes has no room within")
    if path.suffix == ".h5":
        with path.open("r+b") as file:
            file.write(text.ljust(USER_BLOCK))
    elif path.suffix == ".ckpt":
        path.write_bytes(content + len(text).to_bytes(2, "little") + text)
    else:
        (place or beside(path)).write_bytes(text)


def text_of(path: Path) -> bytes:
    """The text of an output's seal, which no other output has. Raises OSError if there is none."""
    if path.suffix == ".h5":
        with path.open("rb", buffering=0) as file:
            return file.read(USER_BLOCK)
    if path.suffix == ".ckpt":
        return _parts(path)[1]
    return (path / NAME if path.is_dir() else beside(path)).read_bytes()


def read(path: Path | str) -> Seal:
    """The seal of an output. Raises DamagedFile if the output or its seal is missing, or the seal is not as written."""
    path = Path(path)
    place = path / NAME if path.is_dir() else path if path.suffix in WITHIN else beside(path)
    problem = f"its seal ({place}) has changed since it was written, or is of another version of palpate"
    try:
        stated = json.loads(text_of(path))
        made_from = stated["made_from"]
        seal = Seal(path, stated["files"], made_from.get("inputs", {}), made_from.get("config", {}))
        if stated["version"] == VERSION and seal.digest == stated["digest"]:
            return seal
    except FileNotFoundError:
        if not os.path.lexists(path):
            raise DamagedFile(f"{path} does not exist; {rebuild_advice(path)}") from None
        problem = f"it has no seal ({place}), or is of another version of palpate"
    except PermissionError:
        raise
    except (OSError, ValueError, LookupError, TypeError, AttributeError) as error:
        problem = f"its seal ({place}) can't be read ({type(error).__name__}), or is of another version of palpate"
    raise damaged(path, problem)


def find(path: Path | str) -> Seal | None:
    """As `read`; None for a file without a seal beside it that is in no run's folder: written by hand, or a copy."""
    path = Path(path)
    plain = not path.is_dir() and path.suffix not in WITHIN and path.exists() and not beside(path).exists()
    return None if plain and not is_of_run(path) else read(path)


def verify(path: Path | str) -> Seal:
    """The seal of an output whose files are all as it states. Raises DamagedFile, naming the first that is not."""
    seal = read(path)
    seal.require()
    return seal


def damaged(path: Path, problem: str) -> DamagedFile:
    remedy = rebuild_advice(path, str(path) if path.is_dir() else "it")
    return DamagedFile(f"{path} is damaged: {problem}; {remedy}")


def digest_in(run: Path, label: str) -> str | None:
    """The digest of an output, or of those of several batches, in a run's folder; None if one is missing or damaged."""
    match = BATCHES.fullmatch(label)
    numbers = match[2].strip("{}").split(",") if match else []
    paths = [run / f"{match[1]}{number}{match[3]}" for number in numbers] if match else [run / label]
    try:
        return _joined([read(path).digest for path in paths])
    except DamagedFile:
        return None


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
    config: the part of the config that its job uses, nested as there. inputs: what the job reads, each after those that
    it was made from. more: digests of further inputs. Raises MixedInputs if the inputs do not fit together."""
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
    config: values that its job uses, by their path. Batches of a stage are one: `touch/batch-{0000,0002}.zarr`."""
    digests = {seal.label: seal.digest for seal in map(find, paths) if seal is not None}
    batches = defaultdict(list)
    for label in sorted(digests):
        match = BATCHES.fullmatch(label)
        batches[(match[1], match[3]) if match else (label, "")].append((match[2] if match else "", digests[label]))
    inputs = {}
    for (start, end), found in batches.items():
        numbers, of_batches = zip(*found, strict=True)
        label = f"{start}{{{','.join(numbers)}}}{end}" if len(found) > 1 else f"{start}{numbers[0]}{end}"
        inputs[label] = _joined(of_batches)
    return {"inputs": inputs, "config": json.loads(json.dumps(dict(config)))}


def join_first(lines: Iterable[str], most: int = 3) -> str:
    lines = list(lines)
    return "; ".join([*lines[:most], *([f"and {len(lines) - most} more"] if len(lines) > most else [])])


def _joined(digests: Sequence[str]) -> str:
    return digests[0] if len(digests) == 1 else hashlib.sha256("\n".join(digests).encode()).hexdigest()


def _text(files: Files, made_from: MadeFrom) -> bytes:
    stated = json.loads(json.dumps(dict(made_from)))
    seal = Seal(Path(), files, stated.get("inputs", {}), stated.get("config", {}))
    text = {"version": VERSION, "digest": seal.digest, "made_from": seal.made_from, "files": files}
    return json.dumps(text).encode()


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
        if path.endswith(tuple(WITHIN)):
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
