"""The page of an object, in a real browser."""

import base64
import json
import re

import numpy as np
import pytest
import trimesh

import palpate
from palpate.viewer import object_page
from tests.dataset.test_forces import forced  # noqa: F401
from tests.viewer.browser import in_browser, needs_browser


@pytest.fixture(scope="module")
def page(built, tmp_path_factory):
    record = palpate.Dataset(built)["ball-0000"]
    prediction = trimesh.creation.box((0.3, 0.3, 0.3)).apply_translation((0, 0, 0.6))
    prediction.visual.vertex_colors = [200, 30, 30, 255]
    path = tmp_path_factory.mktemp("pages") / "ball-0000.html"
    object_page(path, record, predictions=dict.fromkeys((0, 1), prediction), model="some_model")
    return path


def test_a_page_holds_all_that_it_shows(built, page):
    text = page.read_text()
    assert not re.search(r"""(?:src|href)\s*=\s*["']?(?:https?:)?//""", text)
    data = json.loads(re.search(r'<script id="page" type="application/json">(.*?)</script>', text).group(1))
    assert base64.b64decode(data["glb"]) == page.with_suffix(".glb").read_bytes()
    assert len(data["cameras"]) == 1
    grasps = palpate.Dataset(built)["ball-0000"].grasps
    # Images: alone, and of each grasp in the hand and of its four sensors.
    assert text.count('src="data:image/png;base64,') == 1 + len(grasps) * (1 + 4)
    assert text.count("touches nothing") == sum(int((~grasp.success).sum()) for grasp in grasps)
    assert "prediction of some_model" in text


def test_names_can_not_break_a_page(built, tmp_path):
    record = palpate.Dataset(built)["ball-0000"]
    record.class_name = "</script><b>&"
    object_page(tmp_path / "x.html", record, [])
    text = (tmp_path / "x.html").read_text()
    assert "</script><b>" not in text and "&lt;/script&gt;&lt;b&gt;&amp;" in text


def test_a_grasp_that_is_not_there_is_an_error_and_no_page(built, tmp_path):
    with pytest.raises(IndexError, match="ball-0000 has no grasp 2: it has 2"):
        object_page(tmp_path / "x.html", palpate.Dataset(built)["ball-0000"], [2])
    assert not list(tmp_path.iterdir())


@needs_browser
def test_an_object_is_drawn_and_turns_with_the_mouse(page, tmp_path):
    found = in_browser(
        page,
        tmp_path,
        """(found, seen, shown, send, viewer) => {
          found.shown = shown();
          found.first = seen();
          found.again = seen();
          const before = viewer.eye.position.clone();
          send("pointerdown", 200, 200); send("pointermove", 320, 230); send("pointerup", 320, 230);
          found.turned = seen();
          found.moved = before.distanceTo(viewer.eye.position);
          found.distances = [before, viewer.eye.position].map((place) => place.distanceTo(viewer.controls.target));
          for (const box of document.querySelectorAll("input[data-kind]")) {
            if (box.checked !== (box.dataset.kind === "gel")) box.click();
          }
          found.gels = shown();
          document.querySelector("input[name=grasp][value='1']").click();
          found.other = shown();
          found.address = location.hash;
          found.sections = [...document.querySelectorAll("section")].map((part) => part.hidden);
        }""",
    )
    assert found["state"] == "ready"
    kinds = {(name.split(" ")[0], name.split(" ")[1]) for name in found["shown"]}
    expected = {("object", "object"), *(("grasp-0", kind) for kind in ("hand", "gel", "cloud", "prediction"))}
    assert kinds == expected
    assert 0.05 < found["first"]["drawn"] < 0.8
    assert found["first"] == found["again"] != found["turned"]
    assert found["moved"] > 0.05 and found["distances"][0] == pytest.approx(found["distances"][1])
    assert len(found["gels"]) == 4 and {name.split(" ")[:2] == ["grasp-0", "gel"] for name in found["gels"]} == {True}
    assert {name.split(" ")[0] for name in found["other"]} == {"grasp-1"}
    assert found["address"] == "#grasp=1&hide=object,hand,cloud,prediction,camera"
    assert found["sections"] == [True, False]


@needs_browser
def test_the_page_sees_what_the_camera_saw(built, page, tmp_path):
    """The object's outline, from the camera's place, against the mask of the dataset."""
    found = in_browser(
        page,
        tmp_path,
        """(found, seen, shown, send, viewer) => {
          const size = 256, copy = document.createElement("canvas");
          viewer.resize(size, size);
          viewer.render();
          copy.width = copy.height = size;
          const context = copy.getContext("2d");
          context.drawImage(viewer.canvas, 0, 0, size, size);
          const { data } = context.getImageData(0, 0, size, size);
          found.mask = Array.from({ length: size * size }, (_, i) => Number(data[4 * i + 2] < 250)).join("");
        }""",
        "#grasp=0&hide=hand,gel,cloud,prediction,camera&camera=0",
    )
    drawn = np.array(list(found["mask"])).reshape(256, 256) == "1"
    expected = palpate.Dataset(built)["ball-0000"].unoccluded_mask > 0
    expected = expected.repeat(4, axis=0).repeat(4, axis=1)  # of 64 pixels
    overlap = (drawn & expected).sum() / (drawn | expected).sum()
    assert overlap > 0.95  # the mask's pixels are four wide


@needs_browser
def test_arrows_of_forces_end_at_the_contacts_of_the_sliders_frame(forced, tmp_path):  # noqa: F811
    record = palpate.Dataset(forced)["ball-0000"]
    object_page(tmp_path / "x.html", record)
    found = in_browser(
        tmp_path / "x.html",
        tmp_path,
        """(found, seen, shown, send, viewer) => {
          const forces = viewer.leaves.filter(({ group, kind }) => group === "grasp-1" && kind === "force");
          const arrows = () => forces.map(({ node }) => {
            const along = new THREE.Vector3(0, 0, node.scale.z).applyQuaternion(node.quaternion);
            return [...along.toArray(), ...node.position.clone().add(along).toArray()];
          });
          document.querySelector("input[name=grasp][value='1']").click();
          found.shown = shown().filter((name) => name.includes("force")).length;
          const slider = document.getElementById("frame");
          found.arrows = [0, 1, 2].map((frame) => {
            slider.value = frame;
            slider.dispatchEvent(new Event("input"));
            return arrows();
          });
          document.querySelector("input[data-kind=force]").click();
          found.hidden = shown().filter((name) => name.includes("force")).length;
        }""",
    )
    assert (found["shown"], found["hidden"]) == (9, 0)
    frames = record.grasps[1].frames
    for number, arrows in enumerate(np.array(found["arrows"])):
        on_object = (np.arange(9) < frames.contact_count[number]) & (frames.contact_other[number, :9] == -1)
        assert (np.linalg.norm(arrows[~on_object, :3], axis=1) < 2e-4).all()
        force = frames.contact_force[number, :9][on_object, None] * frames.contact_normal[number, :9][on_object]
        np.testing.assert_allclose(arrows[on_object, :3], -0.05 * force, atol=1e-4)  # 50 mm a newton
        np.testing.assert_allclose(arrows[on_object, 3:], frames.contact_position[number, :9][on_object], atol=1e-4)
    assert on_object.sum() > 3


def test_a_page_without_contacts_has_no_switch_for_forces(page):
    assert 'data-kind="hand"' in page.read_text() and 'data-kind="force"' not in page.read_text()
