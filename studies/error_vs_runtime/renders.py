"""Images of objects, unoccluded and in the hand: error against time for the renderer's settings.

Import it before anything that loads embree, because it loads Blender.
"""

from collections.abc import Mapping
from dataclasses import replace
from functools import cached_property, partial
from typing import Any, NamedTuple

from palpate.vision import Camera, Renderer, blender, paper_camera

blender.load()

import numpy as np  # noqa: E402  (Blender comes before what loads embree)

from palpate.scene import Scene  # noqa: E402
from palpate.vision.renderer import CYCLES  # noqa: E402
from studies.error_vs_runtime.study import Method, Study, variants  # noqa: E402
from studies.scenes import rms, scene_of  # noqa: E402
from studies.subjects import Subject  # noqa: E402

# The reference: another draw of random numbers, and nothing omitted.
REFERENCE = 4096  # samples a pixel
BOUNCE_KINDS = ("max", "diffuse", "glossy", "transmission", "transparent_max")
REFERENCE_CYCLES = {f"{kind}_bounces": 24 for kind in BOUNCE_KINDS} | {"seed": 1}
REFERENCE_CYCLES |= {"caustics_reflective": True, "caustics_refractive": True}
CROP = 0.3125  # of an image's side: the reference is rendered of the middle only, to save time
SAMPLES = (1, 4, 8, 32, 64)
BOUNCES = (0, 1, 4, 12)
DENOISED_SHARES = (0.25, 0.5, 1.0)  # of the run's samples
# The denoiser's fastest settings; the others took two to five times as long with the same error.
DENOISER = {"use_denoising": True, "denoising_quality": "FAST", "denoising_prefilter": "NONE"}
BACKGROUND_LEVEL = 250  # of 255: pixels of the reference that are darker show something


class ImagePair(NamedTuple):
    """Unoccluded and occluded image of one object, in its first grasp.

    scene: of the object and that grasp. reference: middles of the two images (s, s, 3) uint8. foreground: their pixels
    (s, s) that errors are of.
    """

    scene: Scene
    reference: list[np.ndarray]
    foreground: list[np.ndarray]


class Renders(Study):
    """Cycles' samples, bounces and denoiser, in images of an object alone and in its first grasp."""

    stage = "renders"
    units = dict.fromkeys(("RMSE", "RMSE alone", "RMSE in the hand"), "grey levels")
    reference = (
        f"{REFERENCE} samples a pixel, 24 bounces of every kind, caustics, another seed; pixels that show"
        " something in the middle of the pictures"
    )

    objects = 2  # in their first grasp

    @property
    def vision(self) -> Mapping[str, Any]:
        """The section `vision` of the config."""
        return self.settings["vision"]

    @cached_property
    def renderer(self) -> Renderer:
        """The renderer of all methods, with the run's settings."""
        return Renderer(self.vision["samples"], self.vision["device"])

    def case(self, subject: Subject) -> ImagePair:
        """The object in its first grasp, with the middles of its reference images."""
        scene = scene_of(self.run, subject)
        case = ImagePair(replace(scene, link_pose=scene.link_pose[:1]), [], [])
        reference = self.reference_images(case)
        foreground = [(image < BACKGROUND_LEVEL).any(axis=-1) for image in reference]
        return case._replace(reference=reference, foreground=foreground)

    def reference_images(self, case: ImagePair, samples: int = REFERENCE) -> list[np.ndarray]:
        """The middles of the two images at reference quality."""
        return self.rendered(case, self.crop_camera, samples, REFERENCE_CYCLES)

    @property
    def crop_camera(self) -> Camera:
        """The camera of the middle of the images only, with the same pixels."""
        whole = paper_camera(self.vision["size"])
        return replace(whole, size=whole.size - 2 * round(whole.size * (1 - CROP) / 2))

    def methods(self) -> list[Method]:
        """Several numbers of samples and bounces, and denoised images."""
        chosen, rendered = self.vision["samples"], self.rendered
        own = CYCLES["diffuse_bounces"]
        shares = sorted({max(1, round(chosen * share)) for share in DENOISED_SHARES})
        denoised = lambda n: partial(rendered, samples=n, cycles=DENOISER)  # noqa: E731
        samples, bounces = sorted({*SAMPLES, chosen}), sorted({*BOUNCES, own})
        return [
            *variants("path tracing", "samples", samples, lambda n: partial(rendered, samples=n), chosen),
            *variants("path tracing", "bounces", bounces, lambda n: partial(rendered, cycles=_bounces(n)), own),
            *variants("denoised by OpenImageDenoise", "samples", shares, denoised),
        ]

    def rendered(self, case: ImagePair, camera: Camera | None = None, samples: int = 0, cycles: Mapping | None = None):
        """The two images, (s, s, 3) uint8 each, with the run's settings unless an argument replaces one."""
        renderer = self.renderer
        renderer.samples = samples or self.vision["samples"]
        renderer.cycles = cycles or {}
        scene = replace(case.scene, camera=camera or paper_camera(self.vision["size"]))
        unoccluded, (occluded,) = renderer.render(scene)
        return [unoccluded.rgb, occluded.rgb]

    def errors(self, case: ImagePair, result: list[np.ndarray]) -> dict[str, float]:
        """Root mean square errors of the foreground: of both images, alone, in the hand."""
        images = [crop(image, len(reference)) for image, reference in zip(result, case.reference, strict=True)]
        triples = zip(images, case.reference, case.foreground, strict=True)
        shown = [(image[at], reference[at]) for image, reference, at in triples]
        both = (np.concatenate(pixels) for pixels in zip(*shown, strict=True))
        values = rms(*both), *(rms(*pair) for pair in shown)
        return dict(zip(self.units, values, strict=True))


def crop(image: np.ndarray, side: int) -> np.ndarray:
    """The middle (side, side, ...) of an image."""
    start = (len(image) - side) // 2
    return image[start : start + side, start : start + side]


def _bounces(number: int) -> dict[str, int]:
    """Settings of Cycles for a number of diffuse and glossy bounces."""
    longest = max(CYCLES["max_bounces"], number)
    return {"diffuse_bounces": number, "glossy_bounces": number, "max_bounces": longest}


study = Renders
