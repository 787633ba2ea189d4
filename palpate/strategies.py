"""Strategies of reconstruction as plain data, without torch: what each takes, begins with and predicts; a class each.
The networks of `palpate.models` do what the classes say. `palpate/methods.yaml` lists the methods that are compared; an
experiment is one of them with inputs (`palpate.experiments`)."""

from typing import ClassVar, Literal

VISIONS = ("unoccluded", "occluded", "views", "none")
CAMERAS = {"unoccluded": "image_camera", "occluded": "image_camera", "views": "camera"}  # arrays, by vision
TouchInput = Literal["graph", "pooled", "readings"]
Start = Literal["charts", "sphere", "templates"]


class Strategy:
    """Vision charts, deformed by the features of an image (paper, section 3). Subclasses say what they change.
    visions: those that it can take. can_touch, needs_touch, needs_vision: whether it can, or has to. takes_images,
    takes_masks: images as they are; where the object is seen in them. touch_input: how touches reach the vertices: as
    charts in the `graph`, `pooled` features of the nearest, `readings` as features, or not. is_trained: whether it is.
    start: what is deformed, if anything. copies_touch: whether the mesh gets touch charts as they are. keeps_touch:
    whether those in the graph stay."""

    visions: ClassVar[tuple[str, ...]] = VISIONS
    can_touch, needs_touch, needs_vision = True, False, False
    takes_images, takes_masks = True, False
    touch_input: ClassVar[TouchInput | None] = None
    is_trained = True
    start: ClassVar[Start | None] = "charts"
    copies_touch = keeps_touch = False

    @classmethod
    def accepts(cls, vision: str, touch: bool) -> bool:
        """Whether it can have these inputs."""
        has_vision = vision != "none"
        needed = (has_vision or touch) and (has_vision or not cls.needs_vision) and (touch or not cls.needs_touch)
        return needed and vision in cls.visions and (cls.can_touch or not touch)

    @classmethod
    def arrays(cls, vision: str, touch: bool, training: bool = False) -> list[str]:
        """The arrays of `palpate.learning.inputs` that it takes; training: with those that only its training takes."""
        names = ["points"]
        if vision != "none":
            names += [vision] * cls.takes_images
            if cls.takes_masks:
                names += ["unoccluded_silhouette"]
                names += ["occluded_silhouette", "hand_silhouette"] * (vision == "occluded")
            names += [CAMERAS[vision]]
        if touch:
            readings = cls.touch_input == "readings"
            names += ["success", "position"] + ["charts"] * (not readings)
            # Rotations of sensors are not taken where touch is only copied, or in the paper's graph.
            names += ["rotation"] * (cls.touch_input in ("readings", "pooled")) + ["reading"] * readings
        return names + ["template"] * (training and cls.start == "templates")


class Charts(Strategy):
    """The paper's equation 1: touch charts are in the graph of vision charts, and in the mesh."""

    touch_input, keeps_touch = "graph", True


class NoCopy(Strategy):
    """The paper's: touch charts in the graph are deformed like the others."""

    touch_input, needs_touch = "graph", True


class NoComm(Strategy):
    """The paper's: touch charts are in the mesh only."""

    copies_touch = needs_touch = needs_vision = True


class Sphere(Strategy):
    """The paper's: a closed sphere, each of whose vertices gets features of all touch readings (section 5.1)."""

    touch_input, start = "readings", "sphere"


class Template(Strategy):
    """Ours: charts that begin as a shape interpolated from training objects (`palpate.models.templates`), features of
    the nearest touches at every vertex, and touch charts in the mesh."""

    visions = ("unoccluded", "occluded", "none")
    takes_masks, start = True, "templates"
    touch_input, copies_touch = "pooled", True


class Retrieval(Strategy):
    """The baseline: the training object that fits best (`palpate.models.retrieval`)."""

    visions = ("unoccluded", "occluded", "none")
    takes_images, takes_masks = False, True
    is_trained, start = False, None


class SingleImage(Strategy):
    """A published network of single images (`palpate.models.single_image`)."""

    visions, can_touch, start = ("views",), False, None


STRATEGIES: dict[str, type[Strategy]] = {
    "charts": Charts,
    "no_copy": NoCopy,
    "no_comm": NoComm,
    "sphere": Sphere,
    "template": Template,
    "retrieval": Retrieval,
    **dict.fromkeys(("psg", "pixel2mesh", "r2n2"), SingleImage),
}


def strategy(name: str) -> type[Strategy]:
    """The strategy of a name. Raises ValueError, naming all, if there is none."""
    if name not in STRATEGIES:
        raise ValueError(f"strategy {name!r}: choose one of {[*STRATEGIES]}")
    return STRATEGIES[name]
