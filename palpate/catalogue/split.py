"""The split of an object, decided by its name alone."""

import hashlib
from collections.abc import Iterable, Mapping

# Objects of the paper's dataset in each split (Smith et al. 2020, supplement, Dataset Statistics).
PAPER_SPLIT = {"train": 1298, "validation": 258, "test": 175}
SPLITS = tuple(PAPER_SPLIT)

# Any salt gives a valid split. Of 20,000 tried this one brings the procedural classes closest to
# PAPER_SPLIT's proportions, class by class, at 20 and 60 objects a class and at the paper's counts.
SALT = "palpate-16865"


def assign_split(object_name: str, ratios: Mapping[str, float] = PAPER_SPLIT) -> str:
    """The split of an object: a hash of its name gives a number in [0, 1), the ratios cut that range in order."""
    return _cut(_fraction(object_name), ratios)


def held_out_styles(class_name: str, styles: Iterable[str], ratios: Mapping[str, float] = PAPER_SPLIT) -> set[str]:
    """The styles of a class that no training object has: those whose names have the smallest hashes, in proportion to
    validation and test; at least one, unless both have no share, and not all."""
    ordered = sorted(styles, key=lambda style: _fraction(f"{class_name}-{style}"))
    rest = 1 - ratios["train"] / sum(ratios[split] for split in SPLITS)
    return set(ordered[: min(max(round(rest * len(ordered)), rest > 0), len(ordered) - 1)])


def suggest_split(object_names: Iterable[str]) -> dict[str, int] | None:
    """Ratios near the paper's, as whole numbers, that put at least one of the objects in each split; of fewer objects
    than splits, in each of the first ones. None for names whose hashes are too close."""
    fractions = sorted(_fraction(name) for name in object_names)
    cuts: list[int] = []
    count, reached = len(fractions), 0.0
    splits, total = SPLITS[:count], sum(PAPER_SPLIT.values())
    for position, split in enumerate(splits[:-1]):
        reached += PAPER_SPLIT[split] / total
        least, most = (cuts[-1] if cuts else 0) + 1, count - len(splits) + 1 + position
        cuts.append(min(max(round(reached * count), least), most))
    places = [0.0, *((fractions[cut - 1] + fractions[cut]) / 2 for cut in cuts), 1.0]
    for whole in (100, 10_000, 10**6, 10**9):
        edges = [round(place * whole) for place in places]
        ratios = {split: edges[i + 1] - edges[i] for i, split in enumerate(splits)}
        if min(ratios.values()) > 0 and {_cut(fraction, ratios) for fraction in fractions} == set(splits):
            return ratios
    return None


def _fraction(name: str) -> float:
    """A number in [0, 1) that depends on the name only."""
    digest = hashlib.sha256(f"{SALT}\0{name}".encode()).digest()
    return int.from_bytes(digest[:8], "big") / 2**64


def _cut(fraction: float, ratios: Mapping[str, float]) -> str:
    """The split at a place in [0, 1), which the ratios cut in order."""
    shares = {split: ratios.get(split, 0) for split in SPLITS}
    total, reached = sum(shares.values()), 0.0
    for split, share in shares.items():
        reached += share
        if fraction * total < reached:
            return split
    raise ValueError(f"split ratios {shares}: expected at least one above 0")
