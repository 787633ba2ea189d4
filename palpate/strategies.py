"""Strategies of reconstruction as plain data, without torch: what each takes, begins with and predicts.
The networks of `palpate.models` do what the rows say. `palpate/methods.yaml` lists the methods that are compared; an
experiment is one of them with inputs (`palpate.experiments`)."""

from dataclasses import dataclass
from typing import Literal

VISIONS = ("unoccluded", "occluded", "views", "none")
CAMERAS = {"unoccluded": "image_camera", "occluded": "image_camera", "views": "camera"}  # arrays, by vision
Start = Literal["charts", "sphere", "templates"]


@dataclass(frozen=True)
class Strategy:
    """A strategy; by default vision charts, deformed by the features of an image (paper, section 3)."""

    visions: tuple[str, ...] = VISIONS  # that it can take
    can_touch: bool = True
    needs_touch: bool = False
    needs_vision: bool = False
    takes_images: bool = True  # as they are
    takes_masks: bool = False  # where the object is seen in images
    # How touches reach the vertices: as charts in the graph, as pooled features of the nearest, as features, or not.
    touch_input: Literal["graph", "pooled", "readings"] | None = None
    is_trained: bool = True
    start: Start | None = "charts"  # what is deformed, if anything
    copies_touch: bool = False  # whether the mesh gets touch charts as they are
    keeps_touch: bool = False  # whether touch charts in the graph stay as they are

    def accepts(self, vision: str, touch: bool) -> bool:
        """Whether it can have these inputs."""
        has_vision = vision != "none"
        needed = (has_vision or touch) and (has_vision or not self.needs_vision) and (touch or not self.needs_touch)
        return needed and vision in self.visions and (self.can_touch or not touch)

    def arrays(self, vision: str, touch: bool, training: bool = False) -> list[str]:
        """The arrays of `palpate.learning.inputs` that it takes; training: with those that only its training takes."""
        names = ["points"]
        if vision != "none":
            names += [vision] * self.takes_images
            if self.takes_masks:
                names += ["unoccluded_silhouette"]
                names += ["occluded_silhouette", "hand_silhouette"] * (vision == "occluded")
            names += [CAMERAS[vision]]
        if touch:
            readings = self.touch_input == "readings"
            names += ["success", "position"] + ["charts"] * (not readings)
            # Rotations of sensors are not taken where touch is only copied, or in the paper's graph.
            names += ["rotation"] * (self.touch_input in ("readings", "pooled")) + ["reading"] * readings
        return names + ["template"] * (training and self.start == "templates")


# A published network of single images (`palpate.models.single_image`).
SINGLE_IMAGE = Strategy(visions=("views",), can_touch=False, start=None)

STRATEGIES = {
    # The paper's equation 1: touch charts are in the graph of vision charts, and in the mesh.
    "charts": Strategy(touch_input="graph", keeps_touch=True),
    # The paper's: touch charts in the graph are deformed like the others.
    "no_copy": Strategy(touch_input="graph", needs_touch=True),
    # The paper's: touch charts are in the mesh only.
    "no_comm": Strategy(copies_touch=True, needs_touch=True, needs_vision=True),
    # The paper's: a closed sphere, each of whose vertices gets features of all touch readings (section 5.1).
    "sphere": Strategy(touch_input="readings", start="sphere"),
    # Ours: charts that begin as a shape interpolated from training objects (`palpate.models.templates`), features of
    # the nearest touches at every vertex, and touch charts in the mesh.
    "template": Strategy(
        visions=("unoccluded", "occluded", "none"),
        takes_masks=True,
        touch_input="pooled",
        start="templates",
        copies_touch=True,
    ),
    # The baseline: the training object that fits best (`palpate.models.retrieval`).
    "retrieval": Strategy(
        visions=("unoccluded", "occluded", "none"), takes_images=False, takes_masks=True, is_trained=False, start=None
    ),
    **dict.fromkeys(("psg", "pixel2mesh", "r2n2"), SINGLE_IMAGE),
}
