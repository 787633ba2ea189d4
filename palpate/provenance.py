"""What a store was made from: the contents of its inputs and the values of the config, back to the source files.

    {"inputs": {"sources": sha256, "meshes": sha256, ...}, "config": {"seed": 0, "vision.size": 256, ...}}

A store states it as its attribute `made_from`, a batch of meshes in `made_from.json`. Inputs and config are those of
the store's own inputs too, so that two stores are compared by what they state, and nothing else is read. Nothing in it
depends on times, paths, or the machine.
"""

import hashlib
import json
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any, NamedTuple

from palpate import checksums
from palpate.rebuild_command import rebuild_advice

RECORD = "made_from.json"
# Keys of the config that say where something is or how it is computed; what they name is in the contents.
NOT_CONTENT = ("device", "exr", "hand")


class MixedInputs(ValueError):
    """Inputs of a job, or stores of a run, were not made from one another; the message names one and the remedy."""


class Made(NamedTuple):
    """One store, or a batch of meshes: the digest of what it holds, and what it was made from."""

    path: Path
    stage: str
    digest: str
    made_from: Mapping[str, Mapping[str, Any]]

    @property
    def inputs(self) -> Mapping[str, str]:
        """Digests of all that it goes back to, by stage; `sources` are the source files."""
        return self.made_from.get("inputs", {})

    @property
    def config(self) -> Mapping[str, Any]:
        """Values of the config that it depends on, by their path."""
        return self.made_from.get("config", {})

    def difference(self, config: Mapping[str, Any], contents: Mapping[str, str]) -> str:
        """How it differs from a run's config (values by path) and contents (digests by stage); empty if it does not.

        What only one side states does not count.
        """
        lines = [
            f"with {key} = {value}, but the run has {config[key]}"
            for key, value in self.config.items()
            if key in config and config[key] != value
        ]
        others = [stage for stage, digest in self.inputs.items() if contents.get(stage, digest) != digest]
        lines += [f"from other {' and '.join(others)} than the run has"] if others else []
        return checksums.join_first(lines)

    def refusal(self, difference: str) -> str:
        """The error message about a difference."""
        return f"{self.path} was made {difference}; {rebuild_advice(self.path)}"


def of_meshes(batch: Path | str) -> Made:
    """A run's batch of meshes. Raises `palpate.checksums.DamagedFile` if it does not state what it was made from."""
    batch = Path(batch)
    remedy = rebuild_advice(batch, str(batch))
    files = checksums.read_manifest(batch, remedy)
    stated = {RECORD: files.get(RECORD, [0, ""])}
    if found := checksums.find_damage(batch, stated, contents=True):
        raise checksums.DamagedFile(f"{batch}: {found[0]}; {remedy}")
    made_from = checksums.read_record(batch / RECORD, remedy)
    return Made(batch, "meshes", checksums.size_and_sha256(batch / checksums.MANIFEST)[1], made_from)


def sources_digest(objects: Iterable[tuple[str, str, str, str, str]]) -> str:
    """SHA-256 of the name, checksum, up axis, scale and turn of a batch's objects, as the catalogue has them."""
    rows = [[*each, turn] if turn else each for *each, turn in objects]
    return hashlib.sha256(json.dumps(rows).encode()).hexdigest()


def by_path(config: Mapping[str, Any], prefix: str = "") -> dict[str, Any]:
    """Values of a nested config by their path, as `vision.size`, without those that do not count."""
    values: dict[str, Any] = {}
    for key, value in config.items():
        if isinstance(value, Mapping):
            values |= by_path(value, f"{prefix}{key}.") if key not in NOT_CONTENT else {}
        elif key not in NOT_CONTENT:
            values[f"{prefix}{key}"] = value
    return values


def combine(config: Mapping[str, Any], *inputs: Made, **digests: str) -> dict[str, dict[str, Any]]:
    """What a store states as `made_from`.

    config: the part of the config that its job uses, nested as there. inputs: what the job reads, each after those
    that it was made from. digests: of further inputs. Raises MixedInputs if the inputs do not fit together.
    """
    values, contents = json.loads(json.dumps(by_path(config))), dict(digests)
    for made in inputs:
        if difference := made.difference(values, contents):
            raise MixedInputs(made.refusal(difference))
        values, contents = {**made.config, **values}, {**made.inputs, **contents, made.stage: made.digest}
    return {"inputs": contents, "config": values}
