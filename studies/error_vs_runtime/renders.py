"""Pictures of objects, alone and in the hand, over what a renderer can be told: error and time.

Import it before anything that loads embree, because it loads Blender.
"""

from collections.abc import Iterator, Mapping
from dataclasses import replace
from functools import cached_property, partial
from pathlib import Path
from typing import Any, NamedTuple

from palpate.vision import Camera, Renderer, blender, paper_camera

blender.load()

import numpy as np  # noqa: E402  (Blender comes before what loads embree)
from PIL import Image as PillowImage  # noqa: E402

from palpate.scene import Scene  # noqa: E402
from palpate.vision.renderer import CYCLES  # noqa: E402
from studies.error_vs_runtime.study import Method, Study  # noqa: E402
from studies.pictures import rms, similarity  # noqa: E402
from studies.scenes import scene_of  # noqa: E402
from studies.subjects import Subject  # noqa: E402

OBJECTS = 2  # that are looked at
# The reference: another draw of random numbers, and nothing omitted.
REFERENCE = 4096  # samples a pixel
FULL = {
    "seed": 1,
    "max_bounces": 24,
    "diffuse_bounces": 24,
    "glossy_bounces": 24,
    "transmission_bounces": 24,
    "transparent_max_bounces": 24,
    "caustics_reflective": True,
    "caustics_refractive": True,
}
MIDDLE = 0.3125  # of a picture's side: the part of it that the reference is of, for its time
SAMPLES = (1, 4, 8, 32, 64)
BOUNCES = (0, 1, 4, 12)
DENOISED = (0.25, 0.5, 1.0)  # of the run's samples
# The quickest of its settings; the others took twice to five times as long, and erred as much.
DENOISER = {"use_denoising": True, "denoising_quality": "FAST", "denoising_prefilter": "NONE"}
ADAPTIVE = (0.1,)  # thresholds of noise, at which a pixel gets no more samples
MOST = 4  # times the run's samples, that it gets before
# Side of what is rendered, over the picture's, and samples a pixel of it, over the run's.
SCALES = ((0.5, 1.0), (0.75, 1.0), (2.0, 0.25))
SHOWS = 250  # of 255: what is darker than this in the reference is no background


class Pictures(NamedTuple):
    """One object alone and in the hand of its first grasp.

    Attributes:
        scene: of the object and that grasp.
        truth: middles of the two pictures (s, s, 3) uint8, and drawn: the pixels that errors are of (s, s).
    """

    scene: Scene
    truth: list[np.ndarray]
    drawn: list[np.ndarray]


def study(run: Path, subjects: list[Subject], settings: Mapping[str, Any]) -> "Renders":
    """Of the first `OBJECTS` objects, in their first grasp. settings: section `vision`."""
    return Renders(Path(run), subjects[:OBJECTS], settings["vision"])


class Renders(Study):
    stage = "renders"
    units = {
        "RMSE": "grey levels",
        "1 - SSIM": "1",
        "RMSE alone": "grey levels",
        "RMSE in the hand": "grey levels",
    }
    reference = (
        f"{REFERENCE} samples a pixel, 24 bounces of every kind, caustics, another seed; pixels that show"
        " something in the middle of the pictures"
    )

    def __init__(self, run: Path, subjects: list[Subject], vision: Mapping[str, Any]):
        self.run, self.subjects, self.vision = run, subjects, vision

    @cached_property
    def renderer(self) -> Renderer:
        return Renderer(self.vision["samples"], self.vision["device"])

    def cases(self) -> Iterator[tuple[str, Pictures]]:
        for subject in self.subjects:
            scene = scene_of(self.run, subject)
            case = Pictures(replace(scene, link_pose=scene.link_pose[:1]), [], [])
            truth = self.true_pictures(case)
            drawn = [(image < SHOWS).any(axis=-1) for image in truth]
            yield subject.name, case._replace(truth=truth, drawn=drawn)

    def true_pictures(self, case: Pictures, samples: int = REFERENCE) -> list[np.ndarray]:
        """The middles of the two pictures, as good as they can be had."""
        return self.rendered(case, self.middle_camera, samples, FULL)

    @property
    def middle_camera(self) -> Camera:
        """The camera that sees the middle of the pictures only, in the same pixels."""
        whole = paper_camera(self.vision["size"])
        return replace(whole, size=whole.size - 2 * round(whole.size * (1 - MIDDLE) / 2))

    def methods(self) -> list[Method]:
        size, chosen = self.vision["size"], self.vision["samples"]
        made = []
        for samples in sorted({*SAMPLES, chosen}):
            run = partial(self.rendered, samples=samples)
            made.append(Method("path tracing", "samples", samples, run, samples == chosen))
        for bounces in sorted({*BOUNCES, CYCLES["diffuse_bounces"]}):
            run = partial(self.rendered, cycles=_bounces(bounces))
            made.append(Method("path tracing", "bounces", bounces, run, bounces == CYCLES["diffuse_bounces"]))
        for samples in sorted({max(1, round(chosen * share)) for share in DENOISED}):
            run = partial(self.rendered, samples=samples, cycles=DENOISER)
            made.append(Method("denoised by OpenImageDenoise", "samples", samples, run))
        for threshold in ADAPTIVE:
            cycles = {"use_adaptive_sampling": True, "adaptive_threshold": threshold}
            run = partial(self.rendered, samples=MOST * chosen, cycles=cycles)
            made.append(Method(f"adaptive, at most {MOST * chosen} samples", "threshold", threshold, run))
        for scale, share in SCALES:
            samples = max(1, round(chosen * share))
            run = partial(self.resized, side=round(size * scale), samples=samples)
            made.append(Method(f"resized, {samples} samples", "scale", scale, run))
        return made

    def rendered(
        self,
        case: Pictures,
        camera: Camera | None = None,
        samples: int | None = None,
        cycles: Mapping[str, Any] | None = None,
    ) -> list[np.ndarray]:
        """The two pictures, as the run renders them but for the arguments: (s, s, 3) uint8 each."""
        renderer = self.renderer
        renderer.samples = samples or self.vision["samples"]
        renderer.cycles = cycles or {}
        scene = replace(case.scene, camera=camera or paper_camera(self.vision["size"]))
        alone, (in_the_hand,) = renderer.render(scene)
        return [alone.rgb, in_the_hand.rgb]

    def resized(self, case: Pictures, side: int, samples: int) -> list[np.ndarray]:
        """Rendered with another number of pixels; enlarged by bicubic interpolation, or reduced by means."""
        size = self.vision["size"]
        how = PillowImage.Resampling.BICUBIC if side < size else PillowImage.Resampling.BOX
        images = self.rendered(case, paper_camera(side), samples)
        return [np.asarray(PillowImage.fromarray(image).resize((size, size), how)) for image in images]

    def errors(self, case: Pictures, result: list[np.ndarray]) -> dict[str, float]:
        images = [middle(image, len(truth)) for image, truth in zip(result, case.truth, strict=True)]
        pairs = list(zip(images, case.truth, case.drawn, strict=True))
        alone, in_the_hand = (rms(image[drawn], truth[drawn]) for image, truth, drawn in pairs)
        alike = np.concatenate([similarity(image, truth)[drawn] for image, truth, drawn in pairs])
        both = [np.concatenate([pair[k][pair[2]] for pair in pairs]) for k in (0, 1)]
        return {
            "RMSE": rms(*both),
            "1 - SSIM": 1 - float(alike.mean()),
            "RMSE alone": alone,
            "RMSE in the hand": in_the_hand,
        }


def middle(image: np.ndarray, side: int) -> np.ndarray:
    """The middle (side, side, ...) of an image."""
    start = (len(image) - side) // 2
    return image[start : start + side, start : start + side]


def _bounces(number: int) -> dict[str, int]:
    """Settings of Cycles for so many diffuse and glossy bounces."""
    longest = max(CYCLES["max_bounces"], number)
    return {"diffuse_bounces": number, "glossy_bounces": number, "max_bounces": longest}
