"""The Allegro's constants are those of the published description, which a data file beside this one quotes."""

from pathlib import Path

import numpy as np
import pytest
import yaml
from scipy.spatial.transform import Rotation

from palpate.hand import MAX_PENETRATION, allegro
from palpate.touch import SENSOR_RANGE

PUBLISHED = yaml.safe_load(Path(__file__).with_name("published_kinematics.yaml").read_text())
CONFIG = Path(__file__).parents[2] / "config" / "config.yaml"
HAND = allegro()


def parent_of(link):
    return HAND.link_names[HAND.link_parent[link]]


def test_it_has_the_published_joints_and_tips_and_no_others():
    assert len(PUBLISHED["joints"]) == 16 and len(PUBLISHED["tips"]) == 4
    assert set(HAND.link_names) == {"palm", *PUBLISHED["joints"], *PUBLISHED["tips"]}
    assert [HAND.link_names[link] for link in HAND.joint_link] == list(PUBLISHED["joints"])
    assert [HAND.link_names[link] for link in HAND.sensor_link] == list(PUBLISHED["tips"])


@pytest.mark.parametrize("name", PUBLISHED["joints"])
def test_joints_are_where_they_were_published_and_turn_as_far(name):
    published, link = PUBLISHED["joints"][name], HAND.link_names.index(name)
    joint = HAND.joint_of_link[link]
    assert parent_of(link) == published["parent"]
    np.testing.assert_array_equal(HAND.link_position[link], published["xyz"])
    rotation = Rotation.from_euler("xyz", published["rpy"]).as_matrix()
    np.testing.assert_allclose(HAND.link_rotation[link], rotation, atol=1e-15)
    np.testing.assert_array_equal(HAND.joint_axis[joint], published["axis"])
    np.testing.assert_array_equal(HAND.joint_range[joint], published["limits"])


@pytest.mark.parametrize("name", PUBLISHED["tips"])
def test_tips_and_their_sensors_are_where_they_were_published(name):
    published, link = PUBLISHED["tips"][name], HAND.link_names.index(name)
    assert parent_of(link) == published["parent"] and HAND.joint_of_link[link] < 0
    np.testing.assert_array_equal(HAND.link_position[link], published["xyz"])
    np.testing.assert_array_equal(HAND.link_rotation[link], np.eye(3))
    sensor = list(HAND.sensor_link).index(link)
    np.testing.assert_array_equal(HAND.sensor_position[sensor], PUBLISHED["sensor"]["xyz"])
    np.testing.assert_array_equal(HAND.sensor_rotation[sensor], PUBLISHED["sensor"]["axes"])
    end = HAND.sensor_position[sensor] + SENSOR_RANGE * HAND.sensor_rotation[sensor][:, 0]
    assert round(end[0], 4) == PUBLISHED["sensor"]["range_ends_at_x"]


def test_the_config_s_limit_on_penetration_is_the_library_s():
    assert yaml.safe_load(CONFIG.read_text())["grasps"]["max_penetration"] == MAX_PENETRATION
