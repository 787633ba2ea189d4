"""What a picture costs and how noisy it is, over the samples a pixel and over what is left out of the render.

    python benchmarks/vision.py [--repeats 3] [--reference 512] [--table samples]

One object of each procedural class, alone and in the hand, 256 x 256, one thread. Times are seconds of CPU a
picture (the least of the repeats), all in: reading the object's file, both renders, EXR, arrays. Errors are
root mean squares over the pixels that show something, in steps of the 8-bit image.
"""

import argparse
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np

from palpate.vision import Image, blender

blender.load()  # before trimesh

from palpate import shapes  # noqa: E402
from palpate.hand import allegro  # noqa: E402
from palpate.mesh import DIAGONAL, OBJECT_POSITION  # noqa: E402
from palpate.vision import Renderer, renderer  # noqa: E402

SAMPLES = (1, 4, 8, 16, 32, 64)
GRASPS = 5  # an object, as in the dataset


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--repeats", type=int, default=3)
    parser.add_argument("--reference", type=int, default=512, help="samples a pixel that count as the truth")
    parser.add_argument("--table", choices=("samples", "settings", "both"), default="both")
    arguments = parser.parse_args()
    hand = allegro()
    with tempfile.TemporaryDirectory() as folder:
        paths = [write_object(Path(folder), name) for name in shapes.CLASSES]
        rendering = Renderer(device="cpu", threads=1)

        def render(grasps: int, repeats: int = arguments.repeats) -> tuple[float, list[Image]]:
            poses, times = held_poses(hand, grasps), []
            for _ in range(repeats):
                start = time.process_time()
                images = [rendering.render_object(path, hand, poses) for path in paths]
                times.append(time.process_time() - start)
            images = [image for alone, held in images for image in (alone, *held)]
            return min(times) / len(images), images

        if arguments.table in ("samples", "both"):
            samples_table(rendering, render, arguments.reference)
        if arguments.table in ("settings", "both"):
            settings_table(rendering, render)


def samples_table(rendering: Renderer, render: Callable, reference: int) -> None:
    """Error and time over samples a pixel."""
    rendering.samples = reference
    _, truth = render(1, repeats=1)
    print("| samples | RMS error | RMS error alone | in the hand | s a picture |\n|---|---|---|---|---|")
    for samples in SAMPLES:
        rendering.samples = samples
        _, images = render(1, repeats=1)
        seconds, _ = render(GRASPS)
        errors = [rms(images[k::s], truth[k::s]) for k, s in ((0, 1), (0, 2), (1, 2))]
        print(f"| {samples} | {' | '.join(f'{error:.1f}' for error in errors)} | {seconds:.3f} |", flush=True)


def settings_table(rendering: Renderer, render: Callable) -> None:
    """Time and change of the picture, of what a render could do besides; as many alone as in the hand."""
    rendering.samples = renderer.SAMPLES
    base, images = render(1)
    print("\n| changed | s a picture | RMS change of the picture |\n|---|---|---|")
    print(f"| nothing | {base:.3f} | 0 |")
    for name, change, undo in changes(rendering):
        change()
        seconds, changed = render(1)
        undo()
        print(f"| {name} | {seconds:.3f} | {rms(changed, images):.2f} |", flush=True)


def write_object(folder: Path, class_name: str) -> Path:
    """The first object of a procedural class, normalised, as a glb file."""
    scene = shapes.make(class_name, 0)
    low, high = scene.bounds
    pose = np.eye(4) * DIAGONAL / np.linalg.norm(high - low)
    pose[:3, 3], pose[3, 3] = -pose[0, 0] * (low + high) / 2, 1
    scene.apply_transform(pose)
    path = folder / f"{class_name}.glb"
    path.write_bytes(scene.export(file_type="glb"))
    return path


def held_poses(hand, count: int) -> np.ndarray:
    """(count, L, 4, 4) link poses: the hand before the object, more and more closed."""
    palm = np.eye(4)
    normal, fingers = np.array([-1.0, 0, 0]), np.array([0, 0.6, 0.8])
    palm[:3, :3] = np.stack([normal, np.cross(fingers, normal), fingers], axis=1)
    palm[:3, 3] = OBJECT_POSITION + np.array([0.09, -0.05, 0])
    bends = np.linspace(0.3, 0.6, count)
    return np.stack([hand.forward(palm, hand.open_joint_positions + bend) for bend in bends])


def rms(images: list[Image], others: list[Image]) -> float:
    """Root mean square difference in 8-bit steps over the pixels that show something in the others."""
    squares = [
        (one.rgb.astype(float) - other.rgb)[np.isfinite(other.depth)] ** 2
        for one, other in zip(images, others, strict=True)
    ]
    return float(np.sqrt(np.mean(np.concatenate(squares))))


def changes(rendering: Renderer) -> list[tuple[str, Callable, Callable]]:
    """What a render could do besides, or otherwise: name, how to switch it on, how to switch it off again."""
    render, cycles = rendering._scene.render, rendering._scene.cycles
    crop = renderer._crop

    def whole_frame() -> None:
        render.use_border, renderer._crop = False, lambda *_: True

    def cropped() -> None:
        render.use_border, renderer._crop = True, crop

    def setting(of, name: str, value) -> tuple[str, Callable, Callable]:
        before = getattr(of, name)
        return (
            f"`{name}` {before} -> {value}",
            lambda: setattr(of, name, value),
            lambda: setattr(of, name, before),
        )

    world = rendering._scene.world.cycles
    return [
        ("the whole frame, not the rectangle that shows something", whole_frame, cropped),
        setting(cycles, "diffuse_bounces", 4),
        setting(cycles, "diffuse_bounces", 0),
        setting(cycles, "glossy_bounces", 4),
        setting(cycles, "max_bounces", 12),
        setting(cycles, "caustics_reflective", True),
        setting(cycles, "use_light_tree", True),
        setting(cycles, "use_adaptive_sampling", True),
        setting(cycles, "use_auto_tile", True),
        setting(cycles, "debug_use_spatial_splits", True),
        setting(cycles, "debug_bvh_type", "STATIC_BVH"),
        setting(world, "sampling_method", "AUTOMATIC"),
        setting(render, "use_persistent_data", True),
        setting(cycles, "use_denoising", True),
    ]


if __name__ == "__main__":
    main()
