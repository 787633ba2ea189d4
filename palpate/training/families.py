"""Families of experiments: those that see the same things are trained on the same pack. No torch, no stores.

A family is `<vision>-<touch>`: vision one of occluded, unoccluded, views, none; touch one of charts,
readings, none.
"""

from collections.abc import Mapping
from typing import Any, NamedTuple

from palpate.catalogue.schema import Invalid


class Source(NamedTuple):
    """Where an array of a pack comes from: a stage's array, which has a row an object, or a row a grasp."""

    stage: str
    name: str
    dtype: str


POINTS = {"points": Source("surface", "points", "float32")}
VISION = {
    "none": {},
    "unoccluded": {"unoccluded": Source("vision", "unoccluded", "uint8")},
    "occluded": {"occluded": Source("vision", "occluded", "uint8")},
    "views": {"views": Source("views", "image", "uint8"), "camera": Source("views", "camera", "float32")},
}
POSES = {
    "success": Source("touch", "success", "bool"),
    "position": Source("touch", "position", "float32"),
    "rotation": Source("touch", "rotation", "float32"),
}
TOUCH = {
    "none": {},
    "charts": {**POSES, "charts": Source("charts", "vertices", "float32")},
    "readings": {**POSES, "reading": Source("touch", "reading", "uint8")},
}


def sources(family: str) -> dict[str, Source]:
    """The arrays of a family's pack by name. Raises Invalid if there is no such family."""
    vision, _, touch = family.partition("-")
    if vision not in VISION or touch not in TOUCH or vision == touch == "none":
        raise Invalid(
            f"no family {family!r}: <vision>-<touch> with vision one of {', '.join(VISION)} "
            f"and touch one of {', '.join(TOUCH)}, not both none"
        )
    return {**POINTS, **VISION[vision], **TOUCH[touch]}


def stages(family: str) -> list[str]:
    """The stages whose stores a family's pack is made from."""
    return list(dict.fromkeys(source.stage for source in sources(family).values()))


def family(experiment: Mapping[str, Any]) -> str:
    """The pack that an experiment is trained on: `<vision>-<touch>`, for example `occluded-charts`.

    Strategy `sphere` takes touch readings as they are, the others take touch charts (paper, section 5.1).
    """
    touch = (
        ("readings" if experiment["strategy"] == "sphere" else "charts") if experiment["touch"] else "none"
    )
    return f"{experiment['vision']}-{touch}"
