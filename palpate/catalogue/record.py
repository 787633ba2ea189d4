"""What a run's folder keeps: the batch of each object, whatever others come and go, and the config that it has.

    <results>/<run>/batches.json    batch_size, and the batch of every object that the run ever had
    <results>/<run>/config.yaml     all keys, defaults included; another run may not write over it

An object that leaves keeps its place, so that nothing else moves into its batch.
"""

import json
from collections import Counter
from collections.abc import Iterable, Mapping
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

import yaml

from palpate.atomic import write_if_changed
from palpate.catalogue.source import CatalogueError, Source
from palpate.catalogue.sources import SourceObject, class_counts
from palpate.configuration import ConfigError, read_yaml
from palpate.rebuild_command import BATCHES, RECORD, rebuild_advice
from palpate.seal import NOTHING, DamagedFile
from palpate.text_files import read_record

# With `batch_size: auto`. The jobs of a batch take 6 s of processor time to start, and each takes Snakemake some ms.
# But one changed object makes its whole batch again (docs/evidence/performance.md).
SMALLEST, LARGEST, FEWEST_BATCHES, MOST_BATCHES = 16, 32, 16, 625


def batch_number(name: str) -> int:
    """The number in a batch's name."""
    return int(name.removeprefix("batch-"))


def assign_batches(names: Iterable[str], batch_size: int, known: Mapping[str, str] | None = None) -> dict[str, str]:
    """The batch of each object by name: known ones stay, others fill the last one and new ones of `batch_size`."""
    places, (last, filled) = dict(known or {}), (0, 0)
    if known:
        last, filled = max(Counter(map(batch_number, known.values())).items())
    for place, name in enumerate((name for name in dict.fromkeys(names) if name not in places), filled):
        places[name] = f"batch-{last + place // batch_size:04d}"
    return places


def in_order(entries: Iterable[SourceObject], places: Mapping[str, str]) -> list[SourceObject]:
    """The objects batch by batch, within a batch in the order given."""
    return sorted(entries, key=lambda entry: batch_number(places[entry.object]))


def read_batches(folder: Path | str, batch_size: int | str, objects: int) -> tuple[int, dict[str, str]]:
    """Objects a batch, and the batch of every object that the run in a folder has had: none if it had another size. For
    `auto` the size is the run's own; a new one has `SMALLEST` to `LARGEST`, as many as leave it `FEWEST_BATCHES`; and
    more, so that it has at most `MOST_BATCHES`. Raises CatalogueError, with the remedy, if the run's own is damaged."""
    path, size = Path(folder, BATCHES), 0
    places: dict[str, str] = {}
    try:
        if path.exists():
            held = read_record(path)
            size = int(held["batch_size"])
            places = {str(name): f"batch-{batch_number(batch):04d}" for name, batch in held["objects"].items()}
    except DamagedFile as error:
        raise CatalogueError(str(error)) from None
    except (ValueError, KeyError, TypeError, AttributeError) as error:
        raise CatalogueError(f"{path} is damaged ({type(error).__name__}): {rebuild_advice(path)}") from None
    if not isinstance(batch_size, int):  # auto
        batch_size = size or max(SMALLEST, min(objects // FEWEST_BATCHES, LARGEST), -(-objects // MOST_BATCHES))
    return batch_size, places if size == batch_size else {}


def write_batches(folder: Path | str, batch_size: int, places: Mapping[str, str]) -> None:
    """Write the batch of every object that the run has or had, if what stands there is another."""
    text = json.dumps({"batch_size": batch_size, "objects": dict(places)}, indent=0) + "\n"
    write_if_changed(Path(folder, BATCHES), text, NOTHING)


def check_same_run(folder: Path | str, config: Mapping[str, Any], project: Path | str) -> None:
    """Raise CatalogueError if a run's folder holds another run than a checked config describes: its source or its seed
    is another, or it has classes that the config does not name. The message names what differs, and the ways out."""
    path = Path(folder, RECORD)
    if not path.is_file():
        return
    try:
        recorded = read_yaml(path)
        before, now = (Source.from_config(keys, project) for keys in (recorded, config))
        if before.kind == now.kind == "procedural":  # made in the run's folder, which may have been moved
            before = replace(before, path=now.path)
        pairs = {f"source.{key}": (old, getattr(now, key)) for key, old in asdict(before).items()}
        pairs["seed"] = pairs.pop("source.seed")
        lines = [f"{key}: {old} there, {new} in this config" for key, (old, new) in pairs.items() if old != new]
        # Folders come and go, so `all` against `all` is no change of the config.
        if not lines and not recorded["classes"] == config["classes"] == "all":
            without = sorted(set(class_counts(recorded, before)) - set(class_counts(config, now)))
            lines += [f"classes: {', '.join(without)} there, not in this config"] * bool(without)
    except (ConfigError, KeyError, TypeError) as error:
        raise CatalogueError(
            f"{path} is damaged ({type(error).__name__}): remove it if this config is that of the run in {folder}"
        ) from None
    if lines:
        raise CatalogueError(
            "\n  ".join([f"{folder} holds another run, which this one would write over:", *lines])
            + "\nGive this run a name of its own: `run: <name>` in its config, or --config run=<name>. "
            f"To go on with the run that is there: --configfile {path}. "
            f"To replace it: remove {folder}; or remove {path} to make again just what differs."
        )


def write_record(folder: Path | str, config: Mapping[str, Any]) -> None:
    """Write the config into a run's folder, if what stands there is another."""
    text = "# The config of this run, as it was last started: `--configfile` takes it.\n"
    text += yaml.safe_dump(dict(config), sort_keys=False, allow_unicode=True)
    write_if_changed(Path(folder, RECORD), text, NOTHING)
