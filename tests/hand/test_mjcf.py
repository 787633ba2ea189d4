"""A user's model file as a hand: the same kinematics as MuJoCo's, and clear errors."""

import importlib.util
import re
from pathlib import Path

import mujoco
import numpy as np
import pytest
import yaml

from palpate.configuration import ConfigError
from palpate.hand import allegro, check_files, from_mjcf, model_files
from palpate.hand.model import build_spec
from palpate.sensor import DIGIT, load

_spec = importlib.util.spec_from_file_location("grippers", Path(__file__).with_name("grippers.py"))
grippers = importlib.util.module_from_spec(_spec)
_spec.loader.exec_module(grippers)


@pytest.fixture
def model_file(tmp_path):
    path = tmp_path / "gripper.xml"
    path.write_text(grippers.two_fingers("radian"))
    return path


def test_kinematics_geoms_and_sensors_are_those_of_the_file(model_file):
    hand = from_mjcf(model_file, grippers.SENSORS, gel_face=0.012)
    assert len(hand.joint_link) == 5 and len(hand.link_names) == 7
    model = mujoco.MjModel.from_xml_path(str(model_file))
    data = mujoco.MjData(model)
    rng = np.random.default_rng(0)
    hinges = [
        model.joint(f"{name}").qposadr[0]
        for name in ("left_turn", "left_bend", "left_curl", "right_bend", "right_curl")
    ]
    for _ in range(10):
        joints = rng.uniform(*hand.joint_range.T)
        data.qpos[hinges] = joints
        data.qpos[:3] = rng.uniform(-1, 1, 3)
        data.qpos[3:7] = rng.normal(size=4)
        mujoco.mj_forward(model, data)
        palm = np.eye(4)
        palm[:3, 3], palm[:3, :3] = data.body("palm").xpos, data.body("palm").xmat.reshape(3, 3)
        links = hand.forward(palm, joints)
        geoms = hand.geom_poses(links)
        np.testing.assert_allclose(geoms[:, :3, 3], data.geom_xpos, atol=1e-9)
        np.testing.assert_allclose(geoms[:, :3, :3], data.geom_xmat.reshape(-1, 3, 3), atol=1e-9)
        position, rotation = hand.sensor_frames(links)
        for sensor, site in enumerate(("left_low", "left_high")):  # in the gel's face
            face = position[sensor] + 0.012 * rotation[sensor][:, 0]
            np.testing.assert_allclose(face, data.site(site).xpos, atol=1e-9)
            np.testing.assert_allclose(rotation[sensor].ravel(), data.site(site).xmat, atol=1e-9)


def test_degrees_and_radians_give_the_same_hand(tmp_path):
    hands = []
    for angle in ("degree", "radian"):
        (tmp_path / f"{angle}.xml").write_text(grippers.two_fingers(angle))
        hands.append(from_mjcf(tmp_path / f"{angle}.xml", grippers.SENSORS))
    np.testing.assert_allclose(hands[0].joint_range, hands[1].joint_range, atol=1e-9)
    np.testing.assert_allclose(hands[0].joint_range[0], np.radians([-20, 20]), atol=1e-9)
    np.testing.assert_allclose(hands[0].link_rotation, hands[1].link_rotation, atol=1e-9)


def test_what_is_drawn_only_does_not_collide(model_file):
    hand = from_mjcf(model_file, grippers.SENSORS)
    assert list(hand.geom_collides).count(False) == 1
    assert hand.geom_size[~hand.geom_collides, 0] == pytest.approx(0.2)
    np.testing.assert_allclose(hand.geom_rgba[0], [0.6, 0.6, 0.7, 1])
    np.testing.assert_allclose(hand.palm_anchor[:3, 3], [0.015, 0, 0.01])


def test_model_built_from_the_hand_has_the_same_kinematics(model_file):
    hand = from_mjcf(model_file, grippers.SENSORS)
    model = build_spec(hand).compile()
    data = mujoco.MjData(model)
    data.qpos = np.random.default_rng(1).uniform(*hand.joint_range.T)
    mujoco.mj_forward(model, data)
    np.testing.assert_allclose(hand.forward(np.eye(4), data.qpos)[:, :3, 3], data.xpos[1:], atol=1e-12)


def test_the_two_hinges_of_one_body_do_not_make_it_collide_with_its_parent(model_file):
    hand = from_mjcf(model_file, grippers.SENSORS)
    adjacent = hand.adjacent_links()
    names = hand.link_names.index
    assert adjacent[names("palm"), names("left")] and adjacent[names("left"), names("left_cap")]
    assert not adjacent[names("palm"), names("left_end")]
    assert not adjacent[names("left"), names("right")]


def test_the_allegro_survives_the_way_through_a_file(tmp_path):
    hand = allegro()
    spec = build_spec(hand)
    spec.compile()
    (tmp_path / "allegro.xml").write_text(spec.to_xml())
    sensors = [
        {"body": hand.link_names[link], "position": hand.sensor_position[sensor].tolist()}
        for sensor, link in enumerate(hand.sensor_link)
    ]
    (tmp_path / "sensors.yaml").write_text(
        yaml.safe_dump({"sensors": sensors, "open": hand.open_joint_positions.tolist()})
    )
    again = from_mjcf(tmp_path / "allegro.xml", tmp_path / "sensors.yaml", gel_face=0.0)
    joints = np.random.default_rng(2).uniform(*hand.joint_range.T)
    for one, other in zip(
        hand.sensor_frames(hand.forward(np.eye(4), joints)),
        again.sensor_frames(again.forward(np.eye(4), joints)),
        strict=True,
    ):
        np.testing.assert_allclose(one, other, atol=1e-5)  # the file has six digits
    np.testing.assert_allclose(hand.joint_range, again.joint_range, atol=1e-5)
    assert again.palm_anchor[0, 3] == pytest.approx(0.0113, abs=1e-6)


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        (
            'name="right_curl"',
            'name="right_curl" type="ball" limited="false"',
            "'right_curl' is neither hinge nor slide",
        ),
        ('name="right_bend"', 'name="right_bend" limited="false"', "'right_bend' has no range"),
        ("</worldbody>", '</worldbody><equality><joint joint1="left_turn"/></equality>', "joint 0 fixes .*'left_turn'"),
        (
            "</worldbody>",
            '</worldbody><equality><connect body1="left_end" body2="world" anchor="0 0 0"/></equality>',
            "connect 0 ties the hand to what is not below its palm",
        ),
    ],
)
def test_what_cannot_be_read_is_named_with_the_file(model_file, old, new, message):
    model_file.write_text(model_file.read_text().replace(old, new))
    with pytest.raises(ValueError, match=f"gripper.xml.*{message}"):
        from_mjcf(model_file, grippers.SENSORS)


def test_a_hand_has_as_many_sensors_as_are_named_and_a_thumb_if_it_is_named(model_file):
    sensors = grippers.SENSORS["sensors"]
    hand = from_mjcf(model_file, {"sensors": sensors[:3], "thumb": ["right_end"]})
    assert hand.sensor_names == ("left_low", "left_high", "right_end")
    assert hand.sensor_thumb.tolist() == [False, False, True]
    assert not from_mjcf(model_file, grippers.SENSORS).sensor_thumb.any()
    with pytest.raises(ValueError, match="gripper.xml.*`thumb` names middle"):
        from_mjcf(model_file, {"sensors": sensors, "thumb": ["middle"]})


def test_no_sensors_or_an_unknown_site_are_named_with_the_file(model_file):
    sensors = grippers.SENSORS["sensors"]
    with pytest.raises(ValueError, match=r"gripper.xml.*\n.*sensors: \[\] should be non-empty"):
        from_mjcf(model_file, {"sensors": []})
    with pytest.raises(ValueError, match="gripper.xml.*nowhere"):
        from_mjcf(model_file, {"sensors": [*sensors[:3], {"site": "nowhere"}]})


def test_files_that_a_model_names_are_found(tmp_path):
    """Below its folders, through included models, in MJCF and URDF; those that exist."""
    for name in ("my parts/a.stl", "my parts/b.stl", "skins/wood.png"):
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).write_bytes(b"")
    (tmp_path / "hand.xml").write_text(
        '<mujoco><compiler meshdir="my parts" texturedir="skins"/><include file="finger.xml"/>'
        '<asset><mesh file="a.stl"/><mesh file="gone.stl"/><texture type="2d" file="wood.png"/></asset>'
        "</mujoco>"
    )
    (tmp_path / "finger.xml").write_text('<mujoco><asset><mesh file="b.stl"/></asset></mujoco>')
    (tmp_path / "hand.urdf").write_text(
        '<robot name="hand"><mujoco><compiler meshdir="my parts"/></mujoco><link name="palm"><visual>'
        '<geometry><mesh filename="package://hand/a.stl"/></geometry></visual></link></robot>'
    )
    (tmp_path / "broken.xml").write_text("<mujoco>")
    found = {
        name: [path.relative_to(tmp_path).as_posix() for path in model_files(tmp_path / name)]
        for name in ("hand.xml", "hand.urdf", "broken.xml")
    }
    assert found == {
        "hand.xml": ["finger.xml", "my parts/a.stl", "my parts/b.stl", "skins/wood.png"],
        "hand.urdf": ["my parts/a.stl"],
        "broken.xml": [],
    }


@pytest.mark.parametrize(
    ("changed", "message"),
    [
        ({"sensors": [{"site": "lef_low"}]}, "gripper.xml has no site 'lef_low', but face, left_low, left_high"),
        ({"palm": "plam"}, "gripper.xml has no body 'plam', but world, palm, left"),
        ({"anchor": "left_low"}, "anchor 'left_low' is not on the palm's body"),
        ({"sensor": []}, "sensor: unknown key; did you mean 'sensors'?"),
        ({"sensors": [{"site": "face", "colour": 1}]}, "sensors.0.colour: unknown key"),
        ({"sensors": [{"site": "left_low"}] * 2}, "{'site': 'left_low'} is named twice"),
        ({"sensors": [{"site": "left_low", "body": "palm"}]}, "expected a site, or a body with a position"),
        ({"sensors": [{"position": [0, 0, 0]}]}, "expected a site, or a body with a position"),
        ({"sensors": [{"body": "left_end", "rotation": [0, 90, 0]}]}, "give radians, not degrees"),
        ({"open": [0, 45, 0, 0, 0]}, "45 is out of the range of 'left_bend', -0.26.* to 1.57"),
        ({"open": [0, 0]}, "`open` has 2 joint positions, the hand has 5 joints"),
        ({"palm": "left_end", "anchor": None}, "'right_end' is not on the hand"),
    ],
)
def test_mistakes_in_the_file_of_the_sensors_name_it(model_file, tmp_path, changed, message):
    (tmp_path / "sensors.yaml").write_text(yaml.safe_dump(grippers.SENSORS | changed))
    with pytest.raises(ConfigError, match=f"(?s)^{tmp_path / 'sensors.yaml'}.*{message}"):
        from_mjcf(model_file, tmp_path / "sensors.yaml")
    (tmp_path / "sensors.yaml").write_text("{")
    with pytest.raises(ConfigError, match="sensors.yaml: can't be read as YAML"):
        from_mjcf(model_file, tmp_path / "sensors.yaml")


@pytest.mark.parametrize("angle", ["degree", "radian"])
def test_degrees_for_radians_name_the_model(tmp_path, angle):
    other = {"degree": "radian", "radian": "degree"}[angle]
    (tmp_path / "hand.xml").write_text(grippers.two_fingers(angle).replace(f'angle="{angle}"', f'angle="{other}"'))
    with pytest.raises(ConfigError, match="hand.xml: .*hinge.*does `<compiler angle"):
        from_mjcf(tmp_path / "hand.xml", grippers.SENSORS)


@pytest.mark.parametrize(
    ("old", "new", "size"), [('pos="0 .04 .035"', 'pos="0 40 35"', "40"), ('".015 .05 .03"', '".015 22.5 .03"', "45")]
)
def test_a_hand_in_millimetres_is_named_with_the_file(model_file, old, new, size):
    model_file.write_text(model_file.read_text().replace(old, new))
    with pytest.raises(ConfigError, match=f"gripper.xml: .* is {size} m from end to end, not 0.01 to 1 m.*in metres"):
        from_mjcf(model_file, grippers.SENSORS)


def test_the_palms_own_joints_are_omitted_and_named(model_file, caplog):
    hand = from_mjcf(model_file, grippers.SENSORS)
    assert len(hand.joint_link) == 5
    assert "gripper.xml: the palm's free joint is omitted: a grasp places the palm" in caplog.text


def test_a_gel_that_is_not_on_its_link_is_named(model_file, tmp_path):
    """The jaws' gels are where their sites are; 3 mm, 24 mm or aside, each is a warning."""
    shipped = [Path(__file__).parents[2] / f"config/hands/wsg50.{ending}" for ending in ("xml", "yaml")]
    assert check_files(*shipped, DIGIT) == check_files(*shipped, load("dome360")) == []
    text = shipped[0].read_text()
    site = 'pos="0.0406 0 0" xyaxes="0 0 -1 0 1 0"'
    assert site in text
    for changed, message in {
        site.replace(
            " 0 0", " 0 0.003", 1
        ): "'upper_gel': the surface of its link is 3 mm beyond its gel's face; a site",
        site.replace(
            " 0 0", " 0 0.024", 1
        ): "'upper_gel': the surface of its link is 24 mm beyond its gel's face, out of the range of digit",
        site.replace(" 0 0", " 0 -0.01", 1): "'upper_gel': the surface of its link is 10 mm behind its gel's face",
        site.replace(" 0 0", " 0.05 0", 1): "'upper_gel': the surface of its link is not on its x",
    }.items():
        (tmp_path / "hand.xml").write_text(text.replace(site, changed))
        (found,) = check_files(tmp_path / "hand.xml", shipped[1], DIGIT)
        assert found.startswith(str(shipped[1])) and re.search(message, found), found
