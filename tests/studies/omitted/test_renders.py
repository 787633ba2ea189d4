"""Every part that pictures leave out, put back in."""

import json

import pandas as pd
import pytest
import trimesh

from studies.omitted.omission import DIFFERS, SAME, results
from studies.omitted.renders import leavings, rewritten

SETTINGS = {
    "seed": 0,
    "vision": {"size": 64, "samples": 8, "device": "cpu"},
    "views": {"size": 40, "samples": 2},
}


@pytest.fixture(scope="module")
def table(pictured):
    run, subject = pictured
    return pd.DataFrame([results(each) for each in leavings(run, [subject], SETTINGS)])


def test_what_is_left_out_changes_nothing_beyond_its_bound(table):
    out = table[table["omitted"]]
    assert len(out) >= 14
    assert (out["verdict"] == SAME).all(), out[["stage", "item", "difference"]]
    exact = out[out["unit"] == "grey levels"]
    assert (exact["bound"] == 0).all() and (exact["difference"] == 0).all()


def test_what_changes_the_picture_stays_in(table):
    kept = table[~table["omitted"]].set_index("item")["verdict"]
    assert set(kept.index) == {"first bounce of light", "second to fourth bounce of light", "hand"}
    assert kept["first bounce of light"] == kept["hand"] == DIFFERS


def test_bytes_of_a_second_image_and_of_a_master(table):
    saved = table.set_index("item")["bytes_saved"]
    assert saved["render for every grasp"] == 64 * 64 * (3 + 1 + 2)
    # Six channels of 32 bits, of which most are background and pack well.
    assert 0 < saved["EXR master"] < 64 * 64 * 6 * 4


def test_rewriting_nothing_keeps_the_rest_of_a_file(tmp_path):
    glb = trimesh.Scene([trimesh.creation.box()]).export(file_type="glb")
    path = tmp_path / "box.glb"
    path.write_bytes(rewritten(glb, lambda tree: tree["asset"].update(extras=json.dumps("more" * 5))))
    assert len(path.read_bytes()) > len(glb)
    assert trimesh.load_scene(path).triangles.tolist() == trimesh.creation.box().triangles.tolist()
