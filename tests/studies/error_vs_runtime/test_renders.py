"""The study of pictures: its reference, its methods, and its errors."""

from dataclasses import replace

import numpy as np
import pytest
import trimesh
from numpy.testing import assert_array_equal

from palpate.hand import allegro
from palpate.mesh import OBJECT_POSITION
from palpate.scene import LIGHTS
from palpate.vision import image, paper_camera, renderer
from studies.error_vs_runtime.renders import REFERENCE, REFERENCE_CYCLES, ImagePair, Renders, crop, study
from studies.scenes import rms
from tests.vision.glb import rewrite_glb
from tests.vision.scenes import grasp_poses, painted, scene_of

VISION = {"size": 64, "samples": 8, "device": "cpu"}
ALBEDO = 0.6


@pytest.fixture(scope="module")
def bottle(pictured):
    """The study of a small run, and its only case."""
    run, subject = pictured
    made = study(run, [subject], {"vision": VISION})
    made.reference_images = lambda case: Renders.reference_images(made, case, 512)  # what the tests need of it
    ((name, case),) = made.cases()
    assert name == "bottle-0006"
    return made, case


def matte_ball(folder):
    """A case: a ball without gloss, the hand in front of it."""
    mesh = painted(trimesh.creation.icosphere(subdivisions=5, radius=0.2), (ALBEDO,) * 3)
    mesh.vertex_normals  # noqa: B018 - written with the file: smooth shading

    def no_gloss(tree):
        tree["extensionsUsed"] = ["KHR_materials_specular"]
        for material in tree["materials"]:
            material["extensions"] = {"KHR_materials_specular": {"specularFactor": 0.0}}

    path = folder / "visual.glb"
    path.write_bytes(rewrite_glb(trimesh.Scene([mesh]).export(file_type="glb"), no_gloss))
    hand = allegro()
    return ImagePair(scene_of(path, hand, grasp_poses(hand)[:1]), [], [])


def test_the_reference_of_a_matte_ball_is_the_closed_form(tmp_path):
    """Of a convex surface nothing else lights: what it sends out is albedo (lamp cos / pi + ambient)."""
    size = 64
    made = Renders(settings={"vision": {**VISION, "size": size}})
    seen = made.reference_images(matte_ball(tmp_path), samples=512)[0]
    camera = replace(paper_camera(size), size=20)
    rays, out = camera.rays(), camera.position - OBJECT_POSITION
    a, b, c = (rays**2).sum(-1), rays @ out, out @ out - 0.2**2
    root = np.sqrt(np.maximum(b**2 - a * c, 0))
    normal = (out + rays * ((-b - root) / a)[..., None]) / 0.2
    sun, ambient = LIGHTS
    lamp = np.subtract(sun.position, OBJECT_POSITION)
    light = sun.energy / np.pi * np.maximum(normal @ lamp / np.linalg.norm(lamp), 0) + ambient.energy
    inside = b**2 - a * c > 0.1 * (b**2 - a * c).max()
    expected = image.srgb(ALBEDO * light)[..., None] * np.ones(3)
    assert inside.mean() > 0.4
    assert rms(seen[inside], expected[inside]) < 1.0


def test_the_reference_is_converged(bottle):
    """Other random numbers, and a quarter of the samples, give nearly the same."""
    made, case = bottle
    better = Renders.reference_images(made, case, REFERENCE)
    other = {**REFERENCE_CYCLES, "seed": 2}
    off = {n: made.rendered(case, made.crop_camera, n, other) for n in (REFERENCE // 64, REFERENCE // 4)}
    for k in (0, 1):
        foreground = (better[k] < 250).any(axis=-1)
        assert foreground.mean() > 0.1
        far, near = (rms(images[k][foreground], better[k][foreground]) for images in off.values())
        assert near < min(1.0, 0.6 * far)


def test_the_reference_shows_the_middle_of_the_picture(bottle):
    made, case = bottle
    for whole, reference in zip(made.rendered(case, samples=64), case.reference, strict=True):
        assert reference.shape == (20, 20, 3) and whole.shape == (64, 64, 3)
        right = rms(crop(whole, 20), reference)
        beside = [rms(crop(np.roll(whole, 1, axis), 20), reference) for axis in (0, 1)]
        assert right < 0.5 * min(beside)


def test_exactly_what_the_run_uses_is_chosen(bottle):
    made, case = bottle
    methods = made.methods()
    chosen = {(each.knob, each.value) for each in methods if each.chosen}
    assert chosen == {("samples", 8), ("bounces", renderer.CYCLES["diffuse_bounces"])}
    assert len({(m.name, m.knob, m.value) for m in methods}) == len(methods)
    for each in (each for each in methods if each.chosen):
        for one, other in zip(each.run(case), made.rendered(case), strict=True):
            assert_array_equal(one, other)


def test_errors_fall_with_samples_and_all_methods_make_the_same_picture(bottle):
    made, case = bottle
    methods = made.methods()
    errors = {str(each): made.errors(case, each.run(case)) for each in methods}
    falling = [errors[f"path tracing, samples {samples}"] for samples in (1, 4, 8, 32, 64)]
    for measure in made.units:
        found = [each[measure] for each in falling]
        assert found == sorted(found, reverse=True) and found[-1] > 0
    worst = errors["path tracing, samples 1"]["RMSE"]
    assert all(each["RMSE"] < 1.2 * worst for each in errors.values())


def test_errors_of_the_truth_itself_are_zero(bottle):
    made, case = bottle
    found = made.errors(case, case.reference)
    assert all(abs(value) < 1e-9 for value in found.values()) and set(found) == set(made.units)
    brighter = [np.where(image < 245, image + 10, image) for image in case.reference]
    assert 5 < made.errors(case, brighter)["RMSE"] <= 10
