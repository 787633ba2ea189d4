"""Scenes that are rendered: pictures of an object alone, in the hand, from all around, and figures."""

from palpate.scene.part import Part, stays

# Of every picture.
PICTURE = {
    "lamp": stays("nearly all that is seen of a shape is seen by its light"),
    "ambient light": stays("it fills the shadows"),
    "first bounce of light": stays("the hand and the object light and colour each other"),
    "second to fourth bounce of light": stays("they cost nothing, and change a picture by half its noise"),
    "bounces of light after the fourth": Part("they change a picture by less than its noise"),
    "paths of more than 6 bounces": Part("only light through many layers of glass takes them"),
    "caustics": Part("they change a picture by less than its noise, and add to it"),
    "tree of lights": Part("there is one lamp: nothing is to be chosen"),
    "pixels around what is drawn": Part("they can only show the background"),
    "samples of mask and depth": Part("all but the first: Cycles takes the two from a pixel's first sample"),
}
# Of an object's file.
FILE = {
    "materials of no triangle": Part("they and their textures reach no pixel"),
    "cameras and lamps of the file": Part("the dataset has its own; a prepared file has none"),
}
MASTER = {
    "EXR master": Part("the run doesn't keep them", lambda facts: "the run keeps them" if facts.get("exr") else None),
}

SCENES: dict[str, dict[str, Part]] = {
    "unoccluded image": {
        "hand": Part("the object is seen alone"),
        "render for every grasp": Part("without a hand the second, third, ... are the first again"),
        **MASTER,
        **FILE,
        **PICTURE,
    },
    "occluded image": {
        "hand": stays("it hides a part of the object"),
        "hand's meshes for every object": Part("it is the same hand: only its links' poses change"),
        **MASTER,
        **FILE,
        **PICTURE,
    },
    "view": {
        "scene for every view": Part("only the camera and the lamp move: Cycles keeps what it made of the object"),
        **FILE,
        **PICTURE,
    },
    "figure": {**FILE, **PICTURE},
}
