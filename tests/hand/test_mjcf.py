"""A user's model file as a hand: the same kinematics as MuJoCo's, and clear errors."""

import importlib.util
import re
from pathlib import Path

import mujoco
import numpy as np
import pytest
import trimesh
import yaml

from palpate.configuration import ConfigError
from palpate.grasp import check_hand, grasp_object
from palpate.grasp.closing import GraspSimulation
from palpate.hand import Hand, allegro, check_files, from_mjcf, model_files
from palpate.hand.model import build_spec
from palpate.mesh import OBJECT_POSITION
from palpate.sensor import DIGIT, load

CASES = Path(__file__).parents[1] / "cases"
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
        '<robot name="hand"><mujoco><compiler meshdir="my parts"/></mujoco><link name="palm"><collision>'
        '<geometry><mesh filename="package://hand/a.stl"/></geometry></collision></link></robot>'
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
        (
            {"palm": "left_end", "anchor": None, "sensors": [{"site": "left_high"}]},
            "no joint is below the palm, 'left_end': name another `palm`",
        ),
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


def contacts_at_rest(model):
    """Pairs of geoms, by their numbers, that MuJoCo has in contact at the model's reference."""
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    return {tuple(sorted(pair)) for pair in data.contact.geom.tolist()}


def test_pairs_that_the_file_excludes_may_be_in_each_other_and_others_are_named(tmp_path):
    case = CASES / "hand-exclude"
    hand = from_mjcf(case / "hand.xml", case / "sensors.yaml")
    assert not contacts_at_rest(mujoco.MjModel.from_xml_path(str(case / "hand.xml")))
    assert not contacts_at_rest(build_spec(hand).compile())
    check_hand(hand)
    ball = trimesh.creation.icosphere(3, 0.03)
    points, _ = trimesh.sample.sample_surface(ball, 3000, seed=0)
    draw = np.random.default_rng(0)
    assert grasp_object(ball, ball, points + OBJECT_POSITION, hand, draw, per_object=2, attempts=2).touches.any()
    text = (case / "hand.xml").read_text()
    (tmp_path / "hand.xml").write_text(text.replace('<exclude body1="palm" body2="b_tip"/>', ""))
    assert contacts_at_rest(mujoco.MjModel.from_xml_path(str(tmp_path / "hand.xml"))) == {(0, 4)}
    with pytest.raises(
        ConfigError, match="its links 'palm' and 'b_tip' are 10.0 mm deep in each other.*exclude the pair"
    ):
        check_hand(from_mjcf(tmp_path / "hand.xml", case / "sensors.yaml"))


def test_geoms_meet_each_other_as_mujoco_says(tmp_path):
    """Links in one place, with random bits, an exclusion, two links that are one body, and a pair; the palm is free."""
    rng = np.random.default_rng(3)
    bits = rng.choice(5, (9, 2))
    bits[:, 1] = np.maximum(bits[:, 1], 1)  # links without a colliding geom don't count between others here
    bits[0] = 1, 1

    def body(number, inner="", joint=True):
        hinge = f'<joint name="j{number}" axis="0 1 0" range="0 1"/>' * joint
        a, b = bits[number]
        return (
            f'<body name="b{number}">{hinge}<geom name="g{number}" type="box" size=".02 .02 .02" contype="{a}"'
            f' conaffinity="{b}"/>{inner}</body>'
        )

    fingers = body(1, body(2, body(3))) + body(4, body(5, body(6, joint=False)) + body(7, body(8)))
    (tmp_path / "hand.xml").write_text(
        '<mujoco><compiler angle="radian"/><worldbody><geom type="plane" size="1 1 1" contype="0" conaffinity="0"/>'
        '<body name="palm"><freejoint/><geom name="g0" type="box"'
        f' size=".02 .02 .02"/>{fingers}</body></worldbody><contact><exclude body1="b1" body2="b5"/>'
        '<pair geom1="g2" geom2="g3"/></contact></mujoco>'
    )
    model = mujoco.MjModel.from_xml_path(str(tmp_path / "hand.xml"))
    expected = {(one - 1, other - 1) for one, other in contacts_at_rest(model)}  # without the plane
    hand = from_mjcf(tmp_path / "hand.xml", {"sensors": [{"body": "b1"}]})
    found = {tuple(pair) for pair in hand.colliding_pairs.tolist()}
    assert 5 < len(expected) < 36 and (2, 3) in expected
    assert found == expected
    assert contacts_at_rest(build_spec(hand).compile()) == expected


@pytest.mark.parametrize("bits", [(4, 0), (0, 2), (0, 0)])
def test_a_geom_with_any_bit_stops_at_the_object(tmp_path, bits):
    (tmp_path / "hand.xml").write_text(
        '<mujoco><compiler angle="radian"/><worldbody><body name="palm"><geom type="box" size=".01 .03 .03"/>'
        '<body name="jaw" pos=".02 0 0"><joint name="jaw" type="slide" axis="1 0 0" range="0 .05"/>'
        f'<geom type="box" size=".005 .02 .02" contype="{bits[0]}" conaffinity="{bits[1]}"/></body></body></worldbody>'
        "</mujoco>"
    )
    hand = from_mjcf(tmp_path / "hand.xml", {"sensors": [{"body": "jaw", "position": [0.005, 0, 0]}]})
    assert hand.geom_collides.tolist() == [True, any(bits)]
    block = trimesh.creation.box((0.02, 0.1, 0.1))
    block.apply_translation([0.05, 0, 0])  # from 40 mm on: the jaw's face is at 25 mm and may go to 75
    simulation = GraspSimulation(hand, [block.vertices])
    simulation.place(np.eye(4), np.zeros(1))
    assert simulation.close(np.array([0.02])).joint_positions[0] == pytest.approx(
        0.015 if any(bits) else 0.02, abs=5e-4
    )


def test_joint_names_are_the_files_and_come_with_the_hand(model_file, tmp_path):
    hand = from_mjcf(model_file, grippers.SENSORS)
    assert hand.joint_names == ("left_turn", "left_bend", "left_curl", "right_bend", "right_curl")
    assert allegro().joint_names[:5] == ("index_0", "index_1", "index_2", "index_3", "middle_0")
    arrays = hand.to_arrays()
    assert arrays["joint_names"].tolist()[0] == b"left_turn"
    assert Hand.from_arrays(arrays).joint_names == hand.joint_names


@pytest.mark.parametrize("sensors", ["sensors", "sensors_palm_base", "sensors_palm_world"])
def test_the_root_of_a_urdf_is_the_palm(sensors):
    case = CASES / "hand-urdf-root"
    hand = from_mjcf(case / "hand.urdf", case / f"{sensors}.yaml")
    assert hand.link_names == ("base", "a_1", "a_2", "b_1", "b_2")
    assert hand.joint_names == ("a_j1", "a_j2", "b_j1", "b_j2")
    assert hand.geom_link.tolist() == [0, 1, 2, 3, 4]
    np.testing.assert_allclose(2 * hand.geom_size[0], [0.02, 0.1, 0.08])
    np.testing.assert_allclose(hand.forward(np.eye(4), np.zeros(4))[2, :3, 3], [0.01, 0.03, 0.1])
    check_hand(hand)


def test_meshes_of_a_urdf_are_found_as_ros_names_them(tmp_path):
    """By `package://`, relative, and by the last part of the name; those of visuals need not be readable."""
    folder = tmp_path / "hands" / "my_hand"
    (folder / "urdf").mkdir(parents=True)
    (folder / "meshes").mkdir()
    trimesh.creation.box((0.02, 0.1, 0.08)).export(folder / "meshes" / "palm.stl")
    text = (CASES / "hand-urdf-root/hand.urdf").read_text()
    box = '<box size="0.02 0.1 0.08"/>'
    for name in ("package://my_hand/meshes/palm.stl", "../meshes/palm.stl", "package://other/meshes/palm.stl"):
        visual = '<visual><geometry><mesh filename="palm.dae"/></geometry></visual><collision>'
        changed = text.replace(box, f'<mesh filename="{name}"/>').replace("<collision>", visual, 1)
        (folder / "urdf" / "hand.urdf").write_text(changed)
        hand = from_mjcf(folder / "urdf" / "hand.urdf", CASES / "hand-urdf-root/sensors.yaml")
        np.testing.assert_allclose(sorted(np.ptp(hand.geom_vertices[0], axis=0)), [0.02, 0.08, 0.1], atol=1e-6)
        assert model_files(folder / "urdf" / "hand.urdf") == [folder / "meshes" / "palm.stl"]
    (folder / "meshes" / "palm.stl").unlink()
    with pytest.raises(ConfigError, match=r"hand.urdf: no mesh 'package://other/meshes/palm.stl'"):
        from_mjcf(folder / "urdf" / "hand.urdf", CASES / "hand-urdf-root/sensors.yaml")


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ((CASES / "hand-no-body/hand.xml").read_text(), "is a part of a model: give the file that includes it"),
        ((CASES / "hand-no-body/geoms_only.xml").read_text(), "the model has no body: give the file that includes it"),
        ("<mujoco>", "can't be read as XML"),
        (
            '<mujoco><worldbody><body><geom size=".02"/><site name="a"/></body></worldbody></mujoco>',
            "no joint is below the palm",
        ),
        ('<robot xmlns:xacro="http://wiki.ros.org/xacro"><xacro:include/></robot>', "is a template: expand it"),
    ],
)
def test_a_file_that_is_no_hand_is_named(tmp_path, text, message):
    (tmp_path / "hand.xml").write_text(text)
    with pytest.raises(ConfigError, match=f"hand.xml: .*{message}"):
        from_mjcf(tmp_path / "hand.xml", {"sensors": [{"site": "a"}]})


def test_a_flat_mesh_may_be_drawn_but_not_collide(model_file):
    flat = 'vertex="0 -.012 0  0 .012 0  .012 -.012 0  .012 .012 0" face="0 1 2  1 3 2"'
    text = re.sub(r'vertex="[^"]*"', flat, model_file.read_text())
    model_file.write_text(text)
    with pytest.raises(ConfigError, match="gripper.xml: .*mesh 'wedge' has coplanar vertices"):
        from_mjcf(model_file, grippers.SENSORS)
    model_file.write_text(text.replace('mesh="wedge" pos', 'contype="0" conaffinity="0" mesh="wedge" pos'))
    hand = from_mjcf(model_file, grippers.SENSORS)
    assert len(hand.geom_vertices[3]) == 4
    check_hand(hand)


def test_open_by_names_and_an_anchor_by_body_and_pose(model_file):
    anchor = {"body": "palm", "position": [0.015, 0, 0.01], "rotation": [0, 0, 0]}
    given = grippers.SENSORS | {"anchor": anchor, "open": {"right_bend": 0.3}}
    hand, as_listed = from_mjcf(model_file, given), from_mjcf(model_file, grippers.SENSORS)
    np.testing.assert_allclose(hand.palm_anchor, as_listed.palm_anchor)
    expected = as_listed.open_joint_positions.copy()
    expected[3] = 0.3
    np.testing.assert_array_equal(hand.open_joint_positions, expected)
    with pytest.raises(ConfigError, match="`open`: no joint 'right', but left_turn, left_bend"):
        from_mjcf(model_file, given | {"open": {"right": 0.3}})
    with pytest.raises(ConfigError, match="anchor 'left_end' is not on the palm's body"):
        from_mjcf(model_file, given | {"anchor": {"body": "left_end"}})


@pytest.mark.parametrize("name", ["hand", "hand_without"])
def test_an_open_hand_that_is_closed_is_named(tmp_path, name):
    case = CASES / "hand-equality"
    (found,) = check_files(case / f"{name}.xml", case / "sensors.yaml", DIGIT)
    assert re.search("open hand is closed: gels 'l_gel' and 'r_gel' touch .4 mm.: give `open`", found)
    sensors = yaml.safe_load((case / "sensors.yaml").read_text()) | {"open": {"l": 0.04, "r": 0.04}}
    (tmp_path / "sensors.yaml").write_text(yaml.safe_dump(sensors))
    assert check_files(case / f"{name}.xml", tmp_path / "sensors.yaml", DIGIT) == []
    (tmp_path / "sensors.yaml").write_text(yaml.safe_dump(sensors | {"open": {"l": 0.04, "r": 0.01}}))
    if name == "hand":
        with pytest.raises(ConfigError, match="'l' follows 'r' to 0.01, not 0.04: give 'r' alone"):
            check_files(case / f"{name}.xml", tmp_path / "sensors.yaml", DIGIT)
