"""Touch with other sensors than the default: resolution, round gels, smoothing, backgrounds."""

from dataclasses import replace

import numpy as np
import pytest
import trimesh

from palpate.sensor import DIGIT, Sensor, load
from palpate.touch import RayCaster, empty_reading, local_points, sense, shade
from palpate.touch.shading import impression, light_of, normals, smoothed

DOME = Sensor.from_description(load("dome360").description() | {"resolution": 60})
MINI = Sensor.from_description(load("gelsight_mini").description() | {"resolution": [48, 60]})
POSE = np.zeros((1, 3)), np.eye(3)[None]


def plate(distance: float) -> trimesh.Trimesh:
    """A large plate `distance` ahead of the sensor plane."""
    mesh = trimesh.creation.box((0.01, 0.2, 0.2))
    mesh.apply_translation((distance + 0.005, 0, 0))
    return mesh


@pytest.mark.parametrize("kind", [DOME, MINI], ids=lambda kind: kind.name)
def test_a_plate_touches_where_the_gel_reaches_it(kind):
    for distance in (0.016, 0.02, 0.0249, 0.0251):
        sensed = sense(RayCaster(plate(distance), sensor=kind), *POSE)
        z, y = np.meshgrid(*kind.pixel_centres, indexing="ij")
        # A plate at d meets a sphere of radius R, its centre at w - R, within a circle: R^2 - (d - w + R)^2.
        circle = y**2 + z**2 <= 0.01**2 - (distance - 0.015) ** 2
        within = circle if kind is DOME else np.full(y.shape, distance < 0.025)
        assert sensed.success[0] == within.any()
        np.testing.assert_array_equal(np.isfinite(sensed.depth[0]), within)
        assert np.allclose(sensed.depth[0][within], distance, atol=2e-5)
        assert sensed.point_count[0] == within.sum() and sensed.points.shape == (1, np.prod(kind.resolution), 3)
        assert RayCaster(plate(distance), sensor=kind).succeeds(*POSE).tolist() == sensed.success.tolist()


def test_a_finer_sensor_sees_the_same_surface():
    """Where pixels of two sensors look along the same ray, they see the same."""
    ball = trimesh.creation.icosphere(subdivisions=3, radius=0.02)
    ball.apply_translation((0.035, 0.002, -0.001))
    fine = replace(DIGIT, resolution=(300, 300))  # the centre of each pixel of 100 is that of one of 300
    coarse, found = (RayCaster(ball, sensor=kind).trace(*POSE)[0] for kind in (DIGIT, fine))
    np.testing.assert_allclose(found[1::3, 1::3], coarse, atol=1e-7)
    cloud = local_points(found, np.array([0.1, 0.2, 0.3]), np.eye(3), fine)
    assert np.abs(cloud[:, 1] - 0.2).max() <= fine.width / 2


def test_a_round_gel_shades_its_own_shape_and_nothing_beside_it():
    empty = empty_reading(DOME)
    assert (empty[~DOME.on_gel] == 0).all() and (empty[DOME.on_gel].max(axis=1) > 0).all()
    # Light by light, in double precision, from the sphere's normal.
    row, column = 22, 35
    y, z = DOME.pixel_centres[1][column], DOME.pixel_centres[0][row]
    normal = np.array([-y, -z, np.sqrt(0.01**2 - y**2 - z**2)]) / 0.01
    height = 0.01 - np.sqrt(0.01**2 - y**2 - z**2)
    towards = np.array([place for place, *_ in DOME.lamps]) - [y, z, height]
    cosine = towards @ normal / np.linalg.norm(towards, axis=1)
    np.testing.assert_allclose(empty[row, column], np.maximum(255 * cosine, 0), atol=2)
    # What is pressed in flat is shaded as a flat gel there.
    pressed = shade(np.full((60, 60), 0.015), DOME)
    flat = shade(np.full((60, 60), 0.015), replace(DOME, gel_radius=None))
    middle = slice(25, 35)
    np.testing.assert_array_equal(pressed[middle, middle], flat[middle, middle])


def blurred(height: np.ndarray, sigma: float) -> np.ndarray:
    """A Gaussian filter of MINI's pixels as a plain sum over them, mirrored at the border."""
    for edge in MINI.pixel:  # along the rows' direction, then along the columns'
        reach = int(4 * sigma / edge + 0.5)
        offsets = np.arange(-reach, reach + 1)
        weights = np.exp(-((offsets * edge) ** 2) / (2 * sigma**2))
        weights /= weights.sum()
        padded = np.pad(height, ((reach, reach), (0, 0)), mode="reflect")
        height = sum(w * padded[reach + k : reach + k + len(height)] for k, w in zip(offsets, weights, strict=True)).T
    return height


def test_smoothing_is_taxims():
    depth = np.full((48, 60), np.inf)
    depth[10:30, 18:33] = 0.0235
    depth[14:20, 20:25] = 0.0225
    height = impression(depth, MINI)
    settings = {"pyramid": [9e-4, 4e-4], "last": 3e-4, "held": 0.4}
    found = smoothed(height, replace(MINI, smoothing=settings))
    expected = height
    for sigma in settings["pyramid"]:
        expected = np.where(height > 0.4 * 0.0025, height, blurred(expected, sigma))
    expected = blurred(expected, settings["last"])
    np.testing.assert_allclose(found, expected, atol=1e-9)
    assert found.max() <= 0.0025 and (found[0] < 1e-4).all()


def test_smoothing_softens_edges_and_facets_and_is_off_by_default():
    """Between the facets of a coarse ball the reading of a soft gel changes less from pixel to pixel."""
    ball = trimesh.creation.icosphere(subdivisions=2, radius=0.02)
    ball.apply_translation((0.042, 0, 0))
    soft = replace(DIGIT, smoothing={"pyramid": [6e-4], "last": 6e-4, "held": 1.0})
    depth = RayCaster(ball).trace(*POSE)[0]
    plain, smooth = shade(depth), shade(depth, soft)
    steps = [np.abs(np.diff(reading.astype(int), axis=1)).max() for reading in (plain, smooth)]
    assert steps[1] < 0.6 * steps[0]
    np.testing.assert_array_equal(empty_reading(soft), empty_reading())
    assert DIGIT.smoothing is None


def test_a_background_is_the_empty_reading_and_touch_changes_it_as_without():
    background = np.random.default_rng(0).integers(90, 160, (100, 100, 3)).astype(np.uint8)
    kind = replace(DIGIT, background=background)
    np.testing.assert_array_equal(empty_reading(kind), background)
    depth = RayCaster(trimesh.creation.icosphere(radius=0.02), (0.0435, 0, 0)).trace(*POSE)[0]
    heights = impression(depth.astype(np.float32)), np.zeros((100, 100), np.float32)
    pressed, empty = (light_of(height, normals(height, DIGIT.pixel)) for height in heights)
    assert np.abs(pressed - empty).max() > 20
    np.testing.assert_array_equal(shade(depth, kind), np.rint(np.clip(background + (pressed - empty), 0, 255)))


def test_grey_levels_above_255_saturate():
    assert shade(np.full((100, 100), 0.02), replace(DIGIT, diffuse=2550)).max() == 255


def test_lights_of_any_number_place_and_colour_add_up():
    """Each light by itself in double precision, on a slope; the reading is their sum, by colour."""
    lights = [
        {"position": [0.02, -0.01, 0.03], "colour": [0.2, 0, 0.5]},
        {"position": [-0.03, 0.01, 0.05], "colour": [0.3, 0.4, 0]},
        {"direction": [-0.5, 0.2, 1], "colour": [0, 0.5, 0.1]},
        {"direction": [0.9, 0, 0.1], "colour": [1, 1, 1]},  # from behind the slope
    ]
    kind = Sensor.from_description(MINI.description() | {"lights": lights, "smoothing": None, "diffuse": 200})
    z, y = np.meshgrid(*kind.pixel_centres, indexing="ij")
    slopes = 0.3, 0.1
    height = 0.004 + slopes[0] * y + slopes[1] * z
    normal = np.array([-slopes[0], -slopes[1], 1]) / np.sqrt(1 + 0.3**2 + 0.1**2)
    expected = np.zeros((*height.shape, 3))
    for light in lights:
        towards = np.broadcast_to(light.get("direction", (0, 0, 0)), (*height.shape, 3))
        if "position" in light:
            towards = np.array(light["position"]) - np.stack([y, z, height], axis=2)
        cosine = towards @ normal / np.linalg.norm(towards, axis=2)
        expected += np.maximum(200 * cosine, 0)[..., None] * light["colour"]
    assert expected.max() < 255
    np.testing.assert_allclose(shade(0.025 - height, kind), expected, atol=0.51)


def test_the_default_ring_of_lights_is_three_lights_of_one_colour_each():
    ring = [{"position": place.tolist(), "colour": colour.tolist()} for place, colour, _ in DIGIT.lamps]
    same = Sensor.from_description(DIGIT.description() | {"lights": ring})
    depth = RayCaster(trimesh.creation.icosphere(subdivisions=2, radius=0.02).apply_translation((0.042, 0, 0))).trace(
        *POSE
    )
    np.testing.assert_array_equal(shade(depth, same), shade(depth, DIGIT))


WIDE = replace(DIGIT, width=0.03, height=0.01, resolution=(20, 60))


@pytest.mark.parametrize("kind", [WIDE, replace(WIDE, width=0.01, height=0.03, resolution=(60, 20))], ids=["y", "z"])
def test_a_sensor_is_as_wide_along_y_and_as_high_along_z_as_it_says(kind):
    """A small plate near the end of the longer side, or as far along the shorter one: the depth of every face."""
    for place in np.array([(0.013, 0), (-0.013, 0), (0, 0.013), (0, -0.013)]):
        mesh = trimesh.creation.box((0.01, 0.002, 0.002), trimesh.transformations.translation_matrix([0.025, *place]))
        caster = RayCaster(mesh, sensor=kind)
        z, y = np.meshgrid(*kind.pixel_centres, indexing="ij")
        covered = (np.abs(y - place[0]) < 0.001) & (np.abs(z - place[1]) < 0.001)
        np.testing.assert_array_equal(np.isfinite(caster.trace(*POSE)[0]), covered)
        assert caster.succeeds(*POSE)[0] == covered.any() == caster.is_near(*POSE)[0]
