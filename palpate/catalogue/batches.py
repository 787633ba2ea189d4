"""Which batch an object is in: one that it keeps, whatever other objects come and go.

    <results>/<run>/batches.json    batch_size, and the batch of every object that the run ever had

An object that leaves keeps its place, so that nothing else moves into its batch. New ones fill the last batch, then
further ones.
"""

import json
from collections import Counter
from collections.abc import Iterable, Mapping
from pathlib import Path

from palpate.atomic import write_if_changed
from palpate.catalogue.source import CatalogueError
from palpate.catalogue.sources import SourceObject
from palpate.rebuild_command import BATCHES, rebuild_advice
from palpate.seal import NOTHING, DamagedFile
from palpate.text_files import read_record

# With `batch_size: auto`. The jobs of a batch take 6 s of processor time to start, and each takes Snakemake some ms.
# But one changed object makes its whole batch again (docs/evidence/performance.md).
SMALLEST, LARGEST, FEWEST_BATCHES, MOST_BATCHES = 16, 32, 16, 625


def batch_name(number: int) -> str:
    """`batch-0000`, ..."""
    return f"batch-{number:04d}"


def batch_number(name: str) -> int:
    """The number in a batch's name."""
    return int(name.removeprefix("batch-"))


def assign_batches(names: Iterable[str], batch_size: int, known: Mapping[str, str] | None = None) -> dict[str, str]:
    """The batch of each object by name, the known ones' first: those stay, the others fill the last batch and new ones.

    A batch has places for `batch_size` objects. Without known ones they are filled in the order of the names given.
    """
    places = dict(known or {})
    counts = Counter(places.values())
    batch = max(counts, key=batch_number, default=batch_name(0))
    filled = counts[batch]
    for name in names:
        if name in places:
            continue
        if filled >= batch_size:
            batch, filled = batch_name(batch_number(batch) + 1), 0
        places[name] = batch
        filled += 1
    return places


def in_order(entries: Iterable[SourceObject], places: Mapping[str, str]) -> list[SourceObject]:
    """The objects batch by batch, within a batch in the order given."""
    return sorted(entries, key=lambda entry: batch_number(places[entry.object]))


def read_batches(folder: Path | str, batch_size: int | str, objects: int) -> tuple[int, dict[str, str]]:
    """Objects a batch, and the batch of every object that the run in a folder has had: none if it had another size.

    The size is the config's number, or for `auto` that of the run, so that its batches stay. A new run has `SMALLEST`
    to `LARGEST`, as many as leave it `FEWEST_BATCHES`; and more, so that it has at most `MOST_BATCHES`.
    Raises CatalogueError, naming the file and the remedy, if the run's own is damaged.
    """
    path, size = Path(folder, BATCHES), 0
    places: dict[str, str] = {}
    try:
        if path.exists():
            held = read_record(path)
            size = int(held["batch_size"])
            places = {str(name): batch_name(batch_number(batch)) for name, batch in held["objects"].items()}
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
