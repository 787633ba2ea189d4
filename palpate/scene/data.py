"""Scenes that make the data: meshes, grasps, and the stores that hold them."""

from collections.abc import Mapping
from typing import Any

from palpate.scene.part import Part, stays, unmodelled


def _too_many_faces(facts: Mapping[str, Any]) -> str | None:
    """Why a level of a mesh must be decimated. Facts: `faces` that there are, `target` that are asked for."""
    if "faces" not in facts or "target" not in facts:
        return "decided level by level, when the faces are known"
    faces, target = facts["faces"], facts["target"]
    return f"{faces:,} faces, and at most {target:,} are asked for" if faces > target else None


MESH = {
    "decimation": Part("the mesh has no more faces than are asked for: it is its own level", _too_many_faces),
    "distance to the source": Part("the level is the source itself: 0", _too_many_faces),
}

GRASP = {
    "visual geometry": Part("the renderer's: nothing collides with it"),
    "gravity": Part("the hand's servos carry its weight, and the object is held"),
    "object degrees of freedom": Part("the object is held where it is: it can't move"),
    "pairs of palm and object": Part("neither moves, and the palm is put where it is clear of the object"),
    "pairs of object patches": Part("they don't move against each other"),
    "faces out of the hand": Part("the check of penetration: none of their points can be inside a link"),
    "links apart": Part("the check of penetration: a plane is between the two links"),
    "pairs of joined links": unmodelled("their boxes overlap at the hinge, where the links themselves don't"),
    "friction": unmodelled("fingers slide to where their servos want them; with it they stick where they touch first"),
    "sag under gravity": unmodelled("servos without compensation end below their targets"),
    "loose object": unmodelled("the first finger would push it away, and its pose would not be known"),
    "self-collision": stays("fingers would pass through each other"),
    "patches out of reach": stays("the engine's tree of boxes passes them by: nothing would be saved"),
}


STORE = {"empty chunks": Part("a chunk that is not there reads as the array's fill value")}

# The points of a sensor that touched nothing are none, and its reading is 0: whole chunks of the fill value.
SCENES: dict[str, dict[str, Part]] = {"mesh": MESH, "grasp": GRASP, "store": STORE}
