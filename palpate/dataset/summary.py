"""What a run has come to, in a few lines: objects used and rejected, why, and the splits."""

import re
from collections import Counter
from pathlib import Path

from palpate.catalogue import SPLITS, CatalogueError
from palpate.dataset.run import Run
from palpate.sensor import warn_of_shallow
from palpate.store import CONTRACT, StoreError

MOST_REASONS = 3
SAMPLED_BATCHES = 20  # whose touches are looked at


def summary(folder: Path | str) -> list[str]:
    """Lines on the objects of a run: how many are used, rejected with the commonest reasons, and in each split; and a
    warning if most touches are shallow.

    An object is used if no stage has rejected it so far. Empty if the run has no catalogue yet.
    """
    run = Run(folder)
    try:
        entries = run.catalogue
    except CatalogueError:
        return []
    rows = [row for row in run.rejections() if row["object"] in entries]
    rejected = {row["object"] for row in rows}
    used = Counter(entry.split for name, entry in entries.items() if name not in rejected)
    counts = ", ".join(f"{split} {used[split]}" for split in SPLITS)
    lines = [f"objects: {len(entries)}, used {len(entries) - len(rejected)} ({counts}), rejected {len(rejected)}"]
    reasons: dict[tuple[str, str], list[str]] = {}
    for row in rows:
        reasons.setdefault((row["stage"], kind_of_reason(row["reason"])), []).append(without_place(row["reason"]))
    for (stage, _), said in sorted(reasons.items(), key=lambda each: -len(each[1]))[:MOST_REASONS]:
        lines.append(f"  {len(said)} at {stage}: {said[0]}{' (the first; numbers differ)' if len({*said}) > 1 else ''}")
    if len(reasons) > MOST_REASONS:
        lines.append(f"  and {len(reasons) - MOST_REASONS} other reasons")
    return lines + [f"  warning: {line}" for line in _warn_of_touches(run)]


def _warn_of_touches(run: Run) -> list[str]:
    """A sentence if most touches of the run's first batches are shallow."""
    counts = Counter()
    made = [batch for batch in run.batches if (run.folder / CONTRACT["touch"].path(batch)).exists()]
    for batch in made[:SAMPLED_BATCHES]:
        try:
            attributes = run.store("touch", batch).attributes
        except StoreError:  # which validation names
            continue
        counts.update({key: attributes.get(key, 0) for key in ("shallow", "touches")})
    return warn_of_shallow(counts["shallow"], counts["touches"])


def kind_of_reason(reason: str) -> str:
    """A reason without what differs from object to object: its file's path in front, and the numbers.

    >>> kind_of_reason("/a/b.stl: holds 12 points, no triangles: export the object's faces")
    "holds N points, no triangles: export the object's faces"
    """
    return re.sub(r"\d[\d,.]*(?:e[+-]?\d+)?", "N", without_place(reason))


def without_place(reason: str) -> str:
    """A reason in one line, without its file's path in front."""
    start, colon, rest = reason.partition(": ")
    return " ".join((rest if colon and "/" in start else reason).split())
