"""Sensors as data: the shipped ones, valid files, and errors for invalid ones."""

import numpy as np
import pytest
import yaml
from PIL import Image

from palpate import sensor
from palpate.configuration import ConfigError, check
from palpate.sensor import DIGIT, SHIPPED, Sensor, load

# As published: the authors' sensor spans 0.00539 to 0.0218 m, with 100 x 100 rays up to w = 0.025 m (supplement).
PUBLISHED = {"edges": (0.00539, 0.0218), "resolution": 100, "range": 0.025}


def test_the_digit_is_the_papers_and_its_lights_as_documented():
    low, high = PUBLISHED["edges"]
    assert DIGIT.width == round(high - low, 5) and DIGIT.pixel == (DIGIT.width / 100, DIGIT.width / 100)
    assert (DIGIT.resolution, DIGIT.range) == (2 * (PUBLISHED["resolution"],), PUBLISHED["range"])
    assert DIGIT.gel_radius is DIGIT.smoothing is DIGIT.background is None and DIGIT.diffuse == 255
    angles, radius = np.deg2rad([-90, 30, 150]), np.sqrt(2) * PUBLISHED["range"]
    expected = np.stack([radius * np.cos(angles), radius * np.sin(angles), np.full(3, PUBLISHED["range"])], axis=1)
    np.testing.assert_array_equal([place for place, *_ in DIGIT.lamps], expected)
    # At the centre of an untouched reading, on the gel, the directions to the lights are orthogonal.
    towards = expected / np.linalg.norm(expected, axis=1, keepdims=True)
    np.testing.assert_allclose(towards @ towards.T, np.eye(3), atol=1e-15)


def test_the_digit_which_is_made_without_its_schema_fits_it():
    check(sensor.read(SHIPPED / "digit.yaml"), sensor.SCHEMA, "the digit")
    assert load("digit").description() == DIGIT.description()


def test_the_shipped_sensors_have_their_published_sizes():
    assert sensor.shipped() == ["digit", "dome360", "gelsight_mini"]
    mini, dome = load("gelsight_mini"), load("dome360")
    assert (mini.width, mini.height, mini.resolution) == (18.6e-3, 14.3e-3, (240, 320))
    assert mini.pixel[1] == pytest.approx(18.6e-3 / 320) == pytest.approx(mini.pixel[0], rel=0.03)
    assert dome.width == 0.020 and dome.gel_radius == 0.010  # the gel of TACTO's OmniTact is 20 mm wide
    # OpenCV's standard deviation of a kernel of k pixels, of Taxim's kernels and its pixels of 0.0295 mm.
    sigmas = [0.0295e-3 * (0.3 * ((k - 1) * 0.5 - 1) + 0.8) for k in (201, 101, 51, 21, 11, 5)]
    np.testing.assert_allclose(mini.smoothing["pyramid"], sigmas, rtol=1e-12)
    assert mini.smoothing["last"] == pytest.approx(sigmas[-1]) and mini.smoothing["held"] == 0.4


def test_a_round_gel_is_a_cap_of_a_sphere():
    dome = load("dome360")
    z, y = np.meshgrid(*dome.pixel_centres, indexing="ij")
    inside = np.hypot(y, z) <= 0.010
    np.testing.assert_array_equal(dome.on_gel, inside)
    # The apex is at the range, the centre of the sphere a radius nearer.
    distance = np.sqrt((dome.reach[inside] - (0.025 - 0.010)) ** 2 + y[inside] ** 2 + z[inside] ** 2)
    np.testing.assert_allclose(distance, 0.010, atol=1e-12)
    assert (dome.reach[~inside] == -np.inf).all() and np.isfinite(dome.sag).all()
    assert (DIGIT.reach == 0.025).all() and DIGIT.on_gel.all()


@pytest.mark.parametrize("name", sensor.shipped())
def test_a_description_brings_the_sensor_back(name):
    one = load(name)
    again = Sensor.from_description(yaml.safe_load(yaml.safe_dump(one.description())))
    assert again.description() == one.description() and not one.geometry_difference(again)
    np.testing.assert_array_equal(one.reach, again.reach)


def test_what_differs_is_named():
    assert DIGIT.geometry_difference(load("dome360")) == (
        "width 0.01641 and 0.02, height 0.01641 and 0.02, resolution (100, 100) and (200, 200), "
        "gel_radius None and 0.01"
    )


@pytest.fixture
def own(tmp_path):
    """Writes a sensor's file, the DIGIT's with some keys changed; returns its path."""

    def write(**changed):
        path = tmp_path / "own.yaml"
        path.write_text(yaml.safe_dump(yaml.safe_load((SHIPPED / "digit.yaml").read_text()) | changed))
        return str(path)

    return write


def test_an_own_sensor_is_a_file_and_its_background_an_image_beside_it(own, tmp_path):
    Image.new("RGB", (64, 32), (10, 200, 30)).save(tmp_path / "gel.png")
    found = load(own(name="mine", resolution=40, background="gel.png"))
    assert found.name == "mine" and found.background.shape == (40, 40, 3)
    np.testing.assert_array_equal(found.background[7, 9], (10, 200, 30))
    assert found.description()["background"] is True
    assert sensor.read(tmp_path / "own.yaml")["background"] == str(tmp_path / "gel.png")


def test_a_sensor_may_extend_another_and_be_rectangular(tmp_path):
    (tmp_path / "gels").mkdir()
    Image.new("RGB", (64, 32), (10, 200, 30)).save(tmp_path / "gels/gel.png")
    (tmp_path / "gels/base.yaml").write_text("{extends: digit, resolution: [24, 32], background: gel.png}")
    (tmp_path / "own.yaml").write_text("{extends: gels/base.yaml, width: 0.032, range: 0.0225}")
    found = load("own.yaml", tmp_path)
    assert found.name == "own" and found.size == (0.024, 0.032) and found.pixel == pytest.approx((0.001, 0.001))
    assert found.plane.shape == (24, 32, 3) and found.background.shape == (24, 32, 3)
    assert (found.range, found.diffuse, found.lights) == (0.0225, DIGIT.diffuse, DIGIT.lights)
    np.testing.assert_allclose(found.plane[3, 5], [0, -0.016 + 5.5e-3, -0.012 + 3.5e-3], atol=1e-15)
    (tmp_path / "gels/base.yaml").write_text("{extends: ../own.yaml}")
    with pytest.raises(ConfigError, match="own.yaml: extends itself"):
        load("own.yaml", tmp_path)


def test_height_and_gel_face_have_defaults():
    short = DIGIT.description() | {"resolution": 100}
    del short["height"], short["gel_face"]
    assert not DIGIT.geometry_difference(Sensor.from_description(short))


@pytest.mark.parametrize(
    ("changed", "message"),
    [
        ({"width": -1}, "width: -1"),
        ({"resolution": 8}, "resolution: 8"),
        ({"colour": 1}, "colour: unknown key"),
        ({"range": float("nan")}, "nan is not a finite number"),
        ({"gel": {"face": {"radius": 0.005}}}, "gel.face.radius 0.005 m is less than half of width"),
        ({"gel": {"face": {"radius": 0.0083}}, "range": 0.005}, "rim of the gel is behind the sensor plane"),
        ({"lights": {"radius": 0.03, "height": 0.01, "angles": [0, 120, 240]}}, "lights.height must be range or more"),
        ({"range": 0.015}, "range 0.015 m does not reach the gel's face on the hand, gel_face 0.019273 m"),
        ({"resolution": [100]}, "resolution: .100. is too short"),
        ({"lights": []}, "lights"),
        ({"lights": [{"colour": [1, 0, 0]}]}, "lights.0: expected a position, or a direction"),
        ({"lights": [{"colour": [1, 0], "position": [0, 0, 1]}]}, r"lights.0.colour: .1, 0. is too short"),
        (
            {"lights": [{"colour": [1, 0, 0], "direction": [0, 0, 0]}]},
            "lights.0: expected a position, or a direction that is not 0",
        ),
        ({"extends": "digitt"}, "digitt: no such file; sensors by name are digit"),
        ({"extends": 1}, "extends: expected the path"),
        ({"background": "nowhere.png"}, "nowhere.png: can't be read as the image"),
        ({"background": True}, "background: expected the path of a file"),
    ],
)
def test_a_sensor_that_cannot_be_is_named_with_its_file(own, changed, message):
    with pytest.raises(ConfigError, match=message) as raised:
        load(own(**changed))
    assert "own.yaml" in str(raised.value) or "nowhere.png" in str(raised.value) or "digitt" in str(raised.value)


def test_a_sensor_that_is_not_there_names_those_that_are(tmp_path):
    with pytest.raises(ConfigError, match="no such file; sensors by name are digit, dome360, gelsight_mini"):
        load("digitt", tmp_path)
    (tmp_path / "list.yaml").write_text("- 1")
    with pytest.raises(ConfigError, match="list.yaml: expected the keys of a sensor"):
        load("list.yaml", tmp_path)
