"""Own cameras, lights and backgrounds: real renders against stored matrices and closed forms."""

from dataclasses import replace

import bpy  # noqa: F401
import numpy as np
import pytest
import trimesh
from numpy.testing import assert_allclose, assert_array_equal
from scipy.stats import kstest, uniform

from palpate.camera import FOCAL_LENGTH, POSITION, ROTATION, looking_at, paper_camera
from palpate.configuration import ConfigError
from palpate.dataset.checks import CHECKS, CheckedObject, check_vision
from palpate.mesh import OBJECT_POSITION
from palpate.scene import LIGHTS, Light, Scene, cameras, draw, lights, look
from palpate.surface.embree import RayMesh
from palpate.vision import Mesh, Renderer
from palpate.vision.image import linear, vision_record
from tests.vision.scenes import ball, grasp_poses, painted, scene_of

SIZE = 128
ALBEDO = 0.8
TWO = [
    looking_at(OBJECT_POSITION, (-0.9, 0.7, 1.1), SIZE, field_of_view=25),
    replace(looking_at((0.05, 0, 0.6), (1.5, -1.8, 0.4), SIZE, up=(0.2, 0, 1)), focal_length=300.0),
]


def test_a_ball_is_where_the_stored_matrices_put_it(write_glb):
    """Its mask's centroid and its depth, by either camera of one scene."""
    centre, radius = np.array([0.06, -0.09, 0.11]), 0.03
    path = write_glb("ball", painted(ball(centre, radius, 4), (ALBEDO,) * 3))
    pictures = Renderer(samples=1, device="cpu").render_cameras(scene_of(path), TWO)
    record = vision_record(pictures, TWO)
    assert record["unoccluded"].shape == (2, SIZE, SIZE, 3)
    for number in range(2):
        away = record["extrinsics"][number] @ (*(centre + OBJECT_POSITION), 1)
        x, y, w = record["intrinsics"][number] @ away
        rows, columns = np.nonzero(record["unoccluded_mask"][number])
        assert len(rows) > 50
        assert_allclose((columns.mean() + 0.5, rows.mean() + 0.5), (x / w, y / w), atol=0.25)
        # The nearest point of a ball is its radius before its centre, but for the angle to the camera's axis.
        nearest = record["unoccluded_depth"][number].astype(float).min()
        assert nearest == pytest.approx(away[2] * (1 - radius / np.linalg.norm(away)), abs=0.003)


def test_two_cameras_see_one_scene_and_each_is_as_if_it_were_alone(write_glb, hand, tmp_path):
    path = write_glb("box", painted(trimesh.creation.box((0.3, 0.2, 0.25)), (0.7, 0.3, 0.2)))
    scene = scene_of(path, hand, grasp_poses(hand), size=SIZE)
    renderer = Renderer(samples=2, device="cpu", exr=tmp_path / "exr")
    pictures = renderer.render_cameras(scene, TWO)
    record = vision_record(pictures, TWO)
    assert record["occluded"].shape == (2, 2, SIZE, SIZE, 3)  # grasps, cameras
    assert_array_equal(record["occluded_mask"][1, 0], pictures[0][1][1].mask)
    alone, held = renderer.render(replace(scene, camera=TWO[1]))
    for found, expected in zip([pictures[1][0], *pictures[1][1]], [alone, *held], strict=True):
        for one, other in zip(found, expected, strict=True):
            assert_array_equal(one, other)
    names = [f"box-{what}{end}.exr" for what in ("unoccluded", "grasp-0", "grasp-1") for end in ("", "-camera-1")]
    assert sorted(file.name for file in (tmp_path / "exr").iterdir()) == sorted(names)

    def failed(rows):
        found = check_vision(CheckedObject({"vision": rows}, path.parent))
        return {name for name, value in found if not np.max(value) <= CHECKS[name].limit}

    assert not failed(record)
    swapped = {name: record[name][::-1] for name in ("intrinsics", "extrinsics")}
    assert "picture of mesh" in failed(record | swapped)


def floor(position=OBJECT_POSITION, half=0.4):
    """A horizontal square of albedo 0.8, and a camera that looks down at it."""
    x, y, z = position
    corners = np.array([[x + a * half, y + b * half, z] for a, b in ((-1, -1), (1, -1), (1, 1), (-1, 1))])
    square = trimesh.Trimesh(corners - OBJECT_POSITION, [[0, 1, 2], [0, 2, 3]], process=False)
    return painted(square, (ALBEDO,) * 3), looking_at(position, np.add(position, (0, 0, 1.5)), 32, 8, up=(0, 1, 0))


@pytest.mark.parametrize("light, irradiance", [
    (Light("sun", 2.0, (0, 0, 3)), 2.0),
    (Light("sun", 2.0, (3.0, 0, 3.6)), 2.0 / np.sqrt(2)),
    (Light("point", 8.0, (0, 0, 1.1), size=0.01), 8 / (4 * np.pi * 0.5**2)),  # as much in all directions
    (Light("point", 8.0, (0, 0, 1.6), size=0.01), 8 / (4 * np.pi)),
    (Light("area", 4.0, (0, 0, 1.6), size=0.02), 4 / np.pi),  # as a matte square sends it
    (Light("area", 4.0, (0, 0, 1.6), (0, 0, 2.0), size=0.02), 0.0),  # to the other side
    (Light("ambient", 0.3), 0.3 * np.pi),
])  # fmt: skip
def test_a_matte_floor_is_as_bright_as_its_light_says(write_glb, light, irradiance):
    """Lights hang between floor and camera, which does not see them."""
    mesh, camera = floor()
    path = write_glb("floor", mesh)
    half = replace(light, colour=(1.0, 0.5, 0.0))
    for lamp, colour in ((light, (1, 1, 1)), (half, linear((1.0, 0.5, 0.0)))):
        scene = Scene(path.parent, camera=camera, lights=(lamp,))
        image, _ = Renderer(samples=64, device="cpu").render(scene)
        shown = linear(image.rgb[12:20, 12:20] / 255).mean(axis=(0, 1))
        # The material's gloss adds a little.
        assert_allclose(shown, np.minimum(ALBEDO / np.pi * irradiance * np.array(colour), 1), atol=0.02, rtol=0.03)


@pytest.mark.parametrize("kind, energy", [("sun", 3.0), ("point", 30.0), ("area", 10.0)])
def test_a_light_from_the_other_side_brightens_the_other_side(write_glb, kind, energy):
    path = write_glb("ball", painted(ball((0, 0, 0), 0.2), (ALBEDO,) * 3))
    camera = looking_at(OBJECT_POSITION, (0, -1.5, 0.6), 48)  # +x is at the right
    renderer = Renderer(samples=8, device="cpu")

    def halves(*lamps):
        image, _ = renderer.render(Scene(path.parent, camera=camera, lights=lamps))
        inside = np.where(image.mask[..., None] > 0, image.rgb.astype(float), np.nan)
        return np.nanmean(inside[:, :24]), np.nanmean(inside[:, 24:])

    size = 0.1 if kind != "sun" else 1.0
    right, left = (Light(kind, energy, (side * 1.2, -0.5, 0.9), size=size) for side in (1, -1))
    of_left, of_right = halves(left), halves(right)
    assert of_left[0] > 2 * of_left[1] and of_right[1] > 2 * of_right[0]
    assert_allclose(of_left, of_right[::-1], rtol=0.1)
    both = halves(left, right)
    assert both[0] > of_left[0] and both[1] > of_right[1]


def test_lights_of_views_go_with_the_camera(write_glb):
    """A ball looks the same from everywhere, by the lights of its scene."""
    path = write_glb("ball", painted(ball((0, 0, 0), 0.2, 5), (ALBEDO,) * 3))
    lamps = (Light("point", 30.0, (1.0, -0.4, 1.5), size=0.05), Light("area", 6.0, (0.2, 1.0, 0.8), size=0.1))
    scene = replace(scene_of(path, size=48), lights=lamps)
    alone, _ = (renderer := Renderer(samples=16, device="cpu")).render(scene)
    turn = trimesh.transformations.rotation_matrix(2.0, (0.3, 0.2, 1), OBJECT_POSITION)
    turned = replace(
        scene.camera,
        position=turn[:3, :3] @ scene.camera.position + turn[:3, 3],
        rotation=turn[:3, :3] @ scene.camera.rotation,
    )
    (view,) = renderer.render_views(scene, [turned])
    difference = np.abs(view.rgb.astype(int) - alone.rgb)[(view.mask > 0) & (alone.mask > 0)]
    assert difference.mean() < 3 and alone.rgb[alone.mask > 0].std() > 30


def test_the_background_has_its_colour_and_lights_nothing(write_glb):
    path = write_glb("ball", painted(ball((0, 0, 0), 0.2), (0.2, 0.6, 0.3)))
    renderer, scene = Renderer(samples=4, device="cpu"), scene_of(path, size=48)
    white, _ = renderer.render(scene)
    blue, _ = renderer.render(replace(scene, background=(0.2, 0.4, 1.0)))
    clear, _ = renderer.render(replace(scene, background=None))
    assert (white.rgb[0, 0] == 255).all() and blue.rgb[0, 0].tolist() == [51, 102, 255]
    assert clear.rgb.shape == (48, 48, 4) and clear.rgb[0, 0].tolist()[3] == 0
    inside = clear.rgb[..., 3] == 255
    assert inside.sum() > 300
    assert_array_equal(blue.rgb[inside], white.rgb[inside])
    assert_array_equal(clear.rgb[inside][:, :3], white.rgb[inside])
    record = vision_record([(clear, [clear])], [scene.camera])
    assert record["unoccluded"].shape == (1, 48, 48, 4) and record["occluded"].shape == (1, 1, 48, 48, 4)


def test_an_object_that_a_camera_does_not_show_is_unusable(write_glb):
    path = write_glb("ball", ball((0, 0, 0), 0.05))
    away = looking_at((3, 0, 0.6), (1, 0, 0.6), 32)
    with pytest.raises(ValueError, match="no pixel of 32 x 32 shows the object camera 1: make"):
        Renderer(samples=1, device="cpu").render_cameras(scene_of(path), [paper_camera(32), away])


def of_config(**changed):
    return {"size": 200, "cameras": None, "lights": None, "background": [1, 1, 1], **changed}


def test_the_configs_defaults_are_the_papers_camera_and_the_lights_of_a_scene():
    (camera,) = cameras(of_config())
    assert_array_equal(camera.matrix(), paper_camera(200).matrix())
    assert lights(of_config()) is LIGHTS and look(of_config()) == {"lights": LIGHTS, "background": (1, 1, 1)}
    assert Scene("x").lights is LIGHTS and Scene("x").background == (1, 1, 1)
    assert look(of_config(background="transparent"))["background"] is None
    for settings in ({}, {"focal_length": FOCAL_LENGTH * 200 / 256}, {"field_of_view": 34.9495}):
        (same,) = cameras(of_config(cameras=[{"position": list(POSITION), "rotation": list(ROTATION), **settings}]))
        assert_allclose(same.matrix(), camera.matrix(), atol=1e-2)


def test_cameras_of_the_config_stand_where_it_says():
    settings = {"position": [1, -1, 1], "target": [0.1, 0, 0.6], "field_of_view": 40, "up": [0, 1, 0]}
    first, second = cameras(of_config(cameras=[settings, {"position": [0, 2, 0.6], "rotation": [90, 0, 180]}]))
    expected = looking_at((0.1, 0, 0.6), (1, -1, 1), 200, 40, (0, 1, 0))
    assert_allclose(first.matrix(), expected.matrix(), atol=1e-9)
    pixels, depth = second.project(np.array([0.1, 0, 0.7]))  # it looks along -y, so that +x is at the left
    assert depth == pytest.approx(2) and pixels[0] < 100 and pixels[1] < 100


@pytest.mark.parametrize("camera, message", [
    ({"position": [1, 0, 1]}, "vision.cameras.0: give either `target`"),
    ({"position": [1, 0, 1], "target": [0, 0, 0.6], "rotation": [0, 0, 0]}, "give either `target`"),
    ({"position": [1, 0, 1], "rotation": [60, 0, 90], "up": [0, 0, 1]}, "`up` belongs to `target`"),
    ({"position": [0, 0, 2], "target": [0, 0, 0.6]}, "choose another `up`"),
    ({"position": [1, 0, 1], "target": [0, 0, 0.6], "focal_length": 9, "field_of_view": 9}, "not both"),
    ({"position": [1, 0, 1], "target": [2, 0, 1]}, "the object's place .* is not in its image"),
])  # fmt: skip
def test_a_camera_of_the_config_that_is_not_determined_is_an_error(camera, message):
    with pytest.raises(ConfigError, match=message):
        cameras(of_config(cameras=[camera]))


def test_lights_of_the_config():
    given = [
        {"kind": "area", "energy": 5, "position": [1, 0, 2], "size": 0.5, "colour": [1, 0.5, 0]},
        {"kind": "ambient", "energy": 0.2},
    ]
    area, ambient = lights(of_config(lights=given))
    assert area == Light("area", 5, (1, 0, 2), None, 0.5, (1, 0.5, 0)) and ambient == Light("ambient", 0.2)
    for wrong, message in [
        ({"kind": "sun", "energy": 1}, "vision.lights.0: light of kind sun needs a position"),
        ({"kind": "ambient", "energy": 1, "position": [0, 0, 1]}, "light of kind ambient has no position"),
        ({"kind": "point", "energy": 1, "position": [0, 0, 1], "target": [0, 0, 0]}, "point has no target"),
        ({"kind": "area", "energy": 1, "position": [0, 0, 1]}, "needs a size above 0"),
        ({"kind": "sun", "energy": 1, "position": [0, 0, 0.6]}, "no direction to shine in"),
    ]:
        with pytest.raises(ConfigError, match=message):
            lights(of_config(lights=[wrong]))


def ranged(low, high):
    return {"from": low, "to": high}


AROUND = {"azimuth": ranged(0, 360), "elevation": ranged(10, 60), "distance": ranged(1.2, 1.6)}
RANDOM = {
    "cameras": [
        {"position": AROUND, "target": [0, ranged(-0.05, 0.05), 0.6], "field_of_view": ranged(30, 40)},
        {"position": [1, 1, ranged(0.4, 0.8)], "target": [0, 0, 0.6]},
    ],
    "lights": [
        {
            "kind": "sun",
            "energy": ranged(1, 3),
            "position": {**AROUND, "distance": 2},
            "colour": [1, ranged(0.5, 1), 1],
        },
        {"kind": "ambient", "energy": ranged(0.2, 0.5)},
    ],
    "background": [ranged(0, 0.5), ranged(0.5, 1), 1],
}


def numbers_of(value):
    """All numbers of nested lists and dictionaries."""
    if isinstance(value, dict | list):
        return [
            number for each in (value.values() if isinstance(value, dict) else value) for number in numbers_of(each)
        ]
    return [] if isinstance(value, str | None) else [value]


def test_without_ranges_nothing_is_drawn():
    given = {"cameras": [{"position": [1, 0, 1], "target": [0, 0, 0.6]}], "lights": [], "background": "transparent"}
    for settings in (of_config(), of_config(**given)):
        assert draw(settings, 3, "mug-0001") == settings


def test_draws_are_of_the_seed_the_object_and_the_key_alone():
    drawn = draw(of_config(**RANDOM), 3, "mug-0001")
    assert draw(of_config(**RANDOM), 3, "mug-0001") == drawn
    others = [draw(of_config(**RANDOM), 4, "mug-0001"), draw(of_config(**RANDOM), 3, "mug-0002")]
    for other in others:  # no number in common but those that are no ranges
        for key, fixed in (("cameras", {0, 0.6, 1}), ("lights", {1, 2}), ("background", {1})):
            assert set(numbers_of(other[key])) & set(numbers_of(drawn[key])) <= fixed
    fewer = draw(of_config(**RANDOM | {"lights": None, "background": [1, 1, 1]}), 3, "mug-0001")
    assert fewer["cameras"] == drawn["cameras"]
    reordered = {**RANDOM, "cameras": [dict(reversed(each.items())) for each in RANDOM["cameras"]]}
    assert draw(of_config(**reordered), 3, "mug-0001") == drawn


def test_draws_are_uniform_in_their_ranges():
    drawn = [draw(of_config(**RANDOM), 0, f"mug-{number:04d}") for number in range(500)]
    seen = [cameras(each)[0] for each in drawn]
    for values, low, high in [
        ([each["cameras"][0]["position"]["azimuth"] for each in drawn], 0, 360),
        ([each["cameras"][0]["field_of_view"] for each in drawn], 30, 40),
        ([each["cameras"][0]["target"][1] for each in drawn], -0.05, 0.05),
        ([lights(each)[0].energy for each in drawn], 1, 3),
        ([look(each)["background"][0] for each in drawn], 0, 0.5),
    ]:
        assert kstest(values, uniform(low, high - low).cdf).pvalue > 1e-4
    for camera, each in zip(seen, drawn, strict=True):
        away = camera.position - each["cameras"][0]["target"]
        place = each["cameras"][0]["position"]
        assert np.linalg.norm(away) == pytest.approx(place["distance"])
        assert np.degrees(np.arcsin(away[2] / np.linalg.norm(away))) == pytest.approx(place["elevation"])
        assert np.degrees(np.arctan2(away[1], away[0])) % 360 == pytest.approx(place["azimuth"])


def test_a_camera_that_would_not_see_the_object_is_drawn_again():
    camera = {"position": [ranged(-1, 1), 2, 0.6], "rotation": [90, 0, 180], "field_of_view": 20}
    drawn = [draw(of_config(cameras=[camera]), 0, str(number)) for number in range(50)]
    offsets = [abs(each["cameras"][0]["position"][0]) for each in drawn]
    assert max(offsets) <= 2 * np.tan(np.radians(10)) < 0.4 and max(offsets) > 0.2
    with pytest.raises(ConfigError, match="vision.cameras.0: the object's place .* is not in its image"):
        draw(of_config(cameras=[{**camera, "position": [ranged(0.9, 1), 2, 0.6]}]), 0, "mug-0001")
    with pytest.raises(ConfigError, match="vision.background.1: from 1 is above to 0.5: exchange them"):
        draw(of_config(background=[1, ranged(1, 0.5), 1]), 0, "mug-0001")


def test_images_by_drawn_cameras_pass_the_validation_with_their_own_alone(write_glb, hand, monkeypatch):
    path = write_glb("box", painted(trimesh.creation.box((0.3, 0.2, 0.25)), (0.7, 0.3, 0.2)))
    renderer, records = Renderer(samples=1, device="cpu"), []
    for seed in (0, 1):
        drawn = draw(of_config(**RANDOM), seed, "box")
        scene = scene_of(path, hand, grasp_poses(hand), size=200)
        scene = replace(scene, **look(drawn))
        records.append(vision_record(renderer.render_cameras(scene, cameras(drawn)), cameras(drawn)))
        corner = records[-1]["unoccluded"][0, 0, 0]
        assert_allclose(corner / 255, scene.background, atol=0.5 / 255)

    def failed(rows):
        found = check_vision(CheckedObject({"vision": rows}, path.parent))
        return {name for name, value in found if not np.max(value) <= CHECKS[name].limit}

    first, second = records
    trees, build = [], RayMesh.__init__
    monkeypatch.setattr(RayMesh, "__init__", lambda rays, mesh: trees.append(mesh) or build(rays, mesh))
    assert not failed(first) and not failed(second)
    assert len(trees) == 2  # one an object, of all its cameras
    assert "picture of mesh" in failed(first | {name: second[name] for name in ("intrinsics", "extrinsics")})


def test_figures_have_the_default_lights_whatever_was_rendered_before(write_glb):
    path = write_glb("ball", painted(ball((0, 0, 0), 0.2), (ALBEDO,) * 3))
    renderer = Renderer(samples=4, device="cpu")
    renderer.render(replace(scene_of(path, size=48), lights=(Light("point", 9.0, (0, 0, 3)),)))
    mesh = ball(OBJECT_POSITION, 0.2)
    first = renderer.render_meshes([Mesh(mesh.vertices, mesh.faces)], camera=paper_camera(48))
    again = Renderer(samples=4, device="cpu").render_meshes([Mesh(mesh.vertices, mesh.faces)], camera=paper_camera(48))
    assert_array_equal(first.rgb, again.rgb)
