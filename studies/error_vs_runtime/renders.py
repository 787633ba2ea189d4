"""Images of objects, unoccluded and in the hand: error against time for the renderer's settings.

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
REFERENCE_CYCLES = {
    "seed": 1,
    "max_bounces": 24,
    "diffuse_bounces": 24,
    "glossy_bounces": 24,
    "transmission_bounces": 24,
    "transparent_max_bounces": 24,
    "caustics_reflective": True,
    "caustics_refractive": True,
}
CROP = 0.3125  # of an image's side: the reference is rendered of the middle only, to save time
SAMPLES = (1, 4, 8, 32, 64)
BOUNCES = (0, 1, 4, 12)
DENOISED_SHARES = (0.25, 0.5, 1.0)  # of the run's samples
# The denoiser's fastest settings; the others took two to five times as long with the same error.
DENOISER = {"use_denoising": True, "denoising_quality": "FAST", "denoising_prefilter": "NONE"}
ADAPTIVE_THRESHOLDS = (0.1,)  # of noise, below which a pixel gets no more samples
ADAPTIVE_FACTOR = 4  # largest number of samples, over the run's
# Side of the rendered image over the run's, and samples a pixel over the run's.
SCALES = ((0.5, 1.0), (0.75, 1.0), (2.0, 0.25))
BACKGROUND_LEVEL = 250  # of 255: pixels of the reference that are darker show something


class ImagePair(NamedTuple):
    """Unoccluded and occluded image of one object, in its first grasp.

    Attributes:
        scene: of the object and that grasp.
        reference: middles of the two images (s, s, 3) uint8. foreground: their pixels (s, s) that errors are of.
    """

    scene: Scene
    reference: list[np.ndarray]
    foreground: list[np.ndarray]


def study(run: Path, subjects: list[Subject], settings: Mapping[str, Any]) -> "Renders":
    """The study of the first `OBJECTS` objects, in their first grasp. settings: section `vision`."""
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

    def cases(self) -> Iterator[tuple[str, ImagePair]]:
        for subject in self.subjects:
            scene = scene_of(self.run, subject)
            case = ImagePair(replace(scene, link_pose=scene.link_pose[:1]), [], [])
            reference = self.reference_images(case)
            foreground = [(image < BACKGROUND_LEVEL).any(axis=-1) for image in reference]
            yield subject.name, case._replace(reference=reference, foreground=foreground)

    def reference_images(self, case: ImagePair, samples: int = REFERENCE) -> list[np.ndarray]:
        """The middles of the two images at reference quality."""
        return self.rendered(case, self.crop_camera, samples, REFERENCE_CYCLES)

    @property
    def crop_camera(self) -> Camera:
        """The camera of the middle of the images only, with the same pixels."""
        whole = paper_camera(self.vision["size"])
        return replace(whole, size=whole.size - 2 * round(whole.size * (1 - CROP) / 2))

    def methods(self) -> list[Method]:
        size, chosen = self.vision["size"], self.vision["samples"]
        methods = []
        for samples in sorted({*SAMPLES, chosen}):
            run = partial(self.rendered, samples=samples)
            methods.append(Method("path tracing", "samples", samples, run, samples == chosen))
        for bounces in sorted({*BOUNCES, CYCLES["diffuse_bounces"]}):
            run = partial(self.rendered, cycles=_bounces(bounces))
            methods.append(Method("path tracing", "bounces", bounces, run, bounces == CYCLES["diffuse_bounces"]))
        for samples in sorted({max(1, round(chosen * share)) for share in DENOISED_SHARES}):
            run = partial(self.rendered, samples=samples, cycles=DENOISER)
            methods.append(Method("denoised by OpenImageDenoise", "samples", samples, run))
        for threshold in ADAPTIVE_THRESHOLDS:
            cycles = {"use_adaptive_sampling": True, "adaptive_threshold": threshold}
            run = partial(self.rendered, samples=ADAPTIVE_FACTOR * chosen, cycles=cycles)
            methods.append(Method(f"adaptive, at most {ADAPTIVE_FACTOR * chosen} samples", "threshold", threshold, run))
        for scale, share in SCALES:
            samples = max(1, round(chosen * share))
            run = partial(self.resized, side=round(size * scale), samples=samples)
            methods.append(Method(f"resized, {samples} samples", "scale", scale, run))
        return methods

    def rendered(
        self,
        case: ImagePair,
        camera: Camera | None = None,
        samples: int | None = None,
        cycles: Mapping[str, Any] | None = None,
    ) -> list[np.ndarray]:
        """The two images, (s, s, 3) uint8 each, with the run's settings unless an argument replaces one."""
        renderer = self.renderer
        renderer.samples = samples or self.vision["samples"]
        renderer.cycles = cycles or {}
        scene = replace(case.scene, camera=camera or paper_camera(self.vision["size"]))
        unoccluded, (occluded,) = renderer.render(scene)
        return [unoccluded.rgb, occluded.rgb]

    def resized(self, case: ImagePair, side: int, samples: int) -> list[np.ndarray]:
        """The two images rendered with `side` pixels, then enlarged bicubically or reduced by averaging."""
        size = self.vision["size"]
        resampling = PillowImage.Resampling.BICUBIC if side < size else PillowImage.Resampling.BOX
        images = self.rendered(case, paper_camera(side), samples)
        return [np.asarray(PillowImage.fromarray(image).resize((size, size), resampling)) for image in images]

    def errors(self, case: ImagePair, result: list[np.ndarray]) -> dict[str, float]:
        images = [crop(image, len(reference)) for image, reference in zip(result, case.reference, strict=True)]
        pairs = list(zip(images, case.reference, case.foreground, strict=True))
        unoccluded, occluded = (rms(image[foreground], reference[foreground]) for image, reference, foreground in pairs)
        ssim = np.concatenate([similarity(image, reference)[foreground] for image, reference, foreground in pairs])
        both = [np.concatenate([pair[k][pair[2]] for pair in pairs]) for k in (0, 1)]
        return {
            "RMSE": rms(*both),
            "1 - SSIM": 1 - float(ssim.mean()),
            "RMSE alone": unoccluded,
            "RMSE in the hand": occluded,
        }


def crop(image: np.ndarray, side: int) -> np.ndarray:
    """The middle (side, side, ...) of an image."""
    start = (len(image) - side) // 2
    return image[start : start + side, start : start + side]


def _bounces(number: int) -> dict[str, int]:
    """Settings of Cycles for a number of diffuse and glossy bounces."""
    longest = max(CYCLES["max_bounces"], number)
    return {"diffuse_bounces": number, "glossy_bounces": number, "max_bounces": longest}
