"""Families of experiments: those that see the same things are trained on the same pack. No torch, no stores.

A family is `<vision>-<touch>`: vision one of occluded, unoccluded, views, none; touch one of charts,
readings, none. What its pack holds, and which stages it is made from, its plan says (`palpate.scene.models`).
"""

from collections.abc import Mapping
from typing import Any, NamedTuple

from palpate.configuration import ConfigError
from palpate.scene import Plan, plan

VISION, TOUCH = ("none", "unoccluded", "occluded", "views"), ("none", "charts", "readings")


class Source(NamedTuple):
    """Where an array of a pack comes from: a stage's array, which has a row an object, or a row a grasp."""

    stage: str
    name: str
    dtype: str


# Arrays by the part of the plan that they are; `points`, the truth, are in every pack.
POINTS = {"points": Source("surface", "points", "float32")}
PARTS = {
    "unoccluded renders": {"unoccluded": Source("vision", "unoccluded", "uint8")},
    "occluded renders": {"occluded": Source("vision", "occluded", "uint8")},
    "views": {"views": Source("views", "image", "uint8"), "camera": Source("views", "camera", "float32")},
    "touch": {
        "success": Source("touch", "success", "bool"),
        "position": Source("touch", "position", "float32"),
        "rotation": Source("touch", "rotation", "float32"),
    },
    "touch charts": {"charts": Source("charts", "vertices", "float32")},
    "touch readings": {"reading": Source("touch", "reading", "uint8")},
}


def scene(family: str) -> Plan:
    """The plan of a family's pack. Raises ConfigError if there is no such family."""
    vision, _, touch = family.partition("-")
    if vision not in VISION or touch not in TOUCH or vision == touch == "none":
        raise ConfigError(
            f"no family {family!r}: <vision>-<touch> with vision one of {', '.join(VISION)} "
            f"and touch one of {', '.join(TOUCH)}, not both none"
        )
    strategy = "sphere" if touch == "readings" else "charts"
    return plan("pack", strategy=strategy, vision=vision, touch=touch != "none")


def sources(family: str, plan: Plan | None = None) -> dict[str, Source]:
    """The arrays of a family's pack by name; plan: the family's own if None."""
    needs = (plan or scene(family)).needs
    needed = [arrays for part, arrays in PARTS.items() if needs(part)]
    return {name: source for arrays in (POINTS, *needed) for name, source in arrays.items()}


def stages(family: str, plan: Plan | None = None) -> list[str]:
    """The stages whose stores a family's pack is made from; plan: the family's own if None."""
    return list(dict.fromkeys(source.stage for source in sources(family, plan).values()))


def family(experiment: Mapping[str, Any]) -> str:
    """The pack that an experiment is trained on: `<vision>-<touch>`, for example `occluded-charts`.

    Strategy `sphere` takes touch readings as they are, the others take touch charts (paper, section 5.1).
    """
    needs = plan("experiment", **experiment).needs
    touch = "charts" if needs("touch charts") else "readings" if needs("touch readings") else "none"
    return f"{experiment['vision']}-{touch}"
