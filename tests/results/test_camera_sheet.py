"""The picture of a config's cameras against renders of the scene that it is of."""

import shutil

import numpy as np
import pytest
import yaml
from PIL import Image

from palpate.camera import looking_at
from palpate.mesh import OBJECT_POSITION
from palpate.results import camera_sheet  # Blender: before embree
from palpate.scene import Scene
from palpate.vision import Renderer

SETTINGS = {"size": 48, "samples": 2, "device": "cpu", "cameras": None, "lights": None, "background": [1, 1, 1]}
AT = (-0.7, 0.9, 0.9)


@pytest.fixture(scope="module")
def copy(run, tmp_path_factory):
    folder = shutil.copytree(run, tmp_path_factory.mktemp("sheet") / "run")
    (folder / "config.yaml").write_text(yaml.safe_dump({"vision": SETTINGS}))
    (folder / "mine.yaml").write_text(
        yaml.safe_dump({"vision": {"cameras": [{"position": AT, "target": OBJECT_POSITION}] * 2}})
    )
    return folder


def test_every_camera_has_a_column_and_the_hand_is_below(copy, dataset, tmp_path):
    arguments = [str(copy), "knife-0000", "--configfile", str(copy / "mine.yaml"), "--output", str(tmp_path / "a.png")]
    assert camera_sheet.main(arguments) == 0
    picture = np.asarray(Image.open(tmp_path / "a.png"))
    cell = 48 + camera_sheet.GAP
    assert picture.shape == (2 * cell, 2 * cell, 3)
    np.testing.assert_array_equal(picture[:, :cell], picture[:, cell:])  # the same camera twice
    scene = Scene(dataset["knife-0000"].mesh, camera=looking_at(OBJECT_POSITION, AT, 48))
    alone, _ = Renderer(samples=2, device="cpu").render(scene)
    np.testing.assert_array_equal(picture[:48, :48], alone.rgb)
    with_hand = picture[cell : cell + 48, :48]
    assert (with_hand != alone.rgb).any(axis=2).mean() > 0.02


def test_what_is_wrong_is_one_line(copy, tmp_path, capsys):
    (copy / "bad.yaml").write_text(yaml.safe_dump({"vision": {"lights": [{"kind": "sun", "energy": 1}]}}))
    for arguments, said in [
        ([str(copy), "teapot-0000"], "'teapot-0000' is not among"),
        ([str(copy), "knife-0000", "--configfile", str(copy / "bad.yaml")], "vision.lights.0: light of kind sun needs"),
        ([str(tmp_path), "knife-0000"], "config.yaml"),
    ]:
        assert camera_sheet.main([*arguments, "--output", str(tmp_path / "x.png")]) == 1
        error = capsys.readouterr().err
        assert said in error and error.count("\n") == 1
    assert not (tmp_path / "x.png").exists()
