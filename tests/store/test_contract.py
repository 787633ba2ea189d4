import csv
import runpy
from pathlib import Path

import numpy as np
import pytest

import palpate.store
from palpate import hand, touch, vision
from palpate.stages import STAGES
from palpate.store import contract
from palpate.store.contract import CONTRACT, SENSOR_NAMES, SYMBOLS, ArraySpec, StoreError, StoreSpec
from palpate.store.files import check_headers
from palpate.vision import views
from workflow.schemas.document import renewed

DOCUMENT = Path(__file__).parents[2] / "docs" / "dataset.md"

# The table of the design: the arrays that users were promised.
PROMISED = {
    "surface": {"points": ((2, 10000, 3), "float32"), "object": ((2,), "string")},
    "grasps": {
        "joint_positions": ((2, 5, 16), "float64"),
        "palm_pose": ((2, 5, 4, 4), "float64"),
        "penetration": ((2, 5), "float32"),
    },
    "touch": {
        "success": ((2, 5, 4), "bool"),
        "position": ((2, 5, 4, 3), "float64"),
        "rotation": ((2, 5, 4, 3, 3), "float64"),
        "depth": ((2, 5, 4, 100, 100), "float32"),
        "reading": ((2, 5, 4, 100, 100, 3), "uint8"),
        "points": ((2, 5, 4, 10000, 3), "float32"),
        "point_count": ((2, 5, 4), "int32"),
        "empty_reading": ((100, 100, 3), "uint8"),
    },
    "vision": {
        "unoccluded": ((2, 1, 256, 256, 3), "uint8"),
        "occluded": ((2, 5, 1, 256, 256, 3), "uint8"),
        "unoccluded_mask": ((2, 1, 256, 256), "uint8"),
        "occluded_mask": ((2, 5, 1, 256, 256), "uint8"),
        "unoccluded_depth": ((2, 1, 256, 256), "float16"),
        "occluded_depth": ((2, 5, 1, 256, 256), "float16"),
        "intrinsics": ((2, 1, 3, 3), "float64"),
        "extrinsics": ((2, 1, 3, 4), "float64"),
    },
    "views": {
        "image": ((2, 24, 137, 137, 3), "uint8"),
        "mask": ((2, 24, 137, 137), "uint8"),
        "camera": ((2, 24, 3, 4), "float64"),
    },
}
SIZES = {
    "o": 2,
    "g": 5,
    "n": 10000,
    "s": 4,
    "j": 16,
    "r": 100,
    "c": 100,
    "rc": 10000,
    "k": 1,
    "p": 256,
    "b": 3,
    "v": 24,
}
SIZES |= {"q": 137}


def test_the_contract_holds_what_was_promised():
    for stage, arrays in PROMISED.items():
        for name, (shape, dtype) in arrays.items():
            spec = CONTRACT[stage].arrays[name]
            assert spec.dtype == dtype
            assert shape == tuple(SIZES.get(axis, axis) for axis in spec.shape), (stage, name)


def test_every_symbol_and_array_is_explained():
    used = {
        axis
        for store in CONTRACT.values()
        for spec in store.arrays.values()
        for axis in spec.shape
        if isinstance(axis, str)
    }
    assert used == set(SYMBOLS)
    assert all(spec.meaning for store in CONTRACT.values() for spec in store.arrays.values())


def test_what_users_read_is_the_contract():
    text = DOCUMENT.read_text(encoding="utf-8")
    assert text == renewed("docs/dataset.md"), "run: python workflow/schemas/document.py"


def test_the_documents_example_runs(built, capsys):
    example = (DOCUMENT.parent / "reading.md").read_text(encoding="utf-8").split("```python\n")[1].split("```")[0]
    names = {}
    exec(example.replace("results/default", str(built)).replace('"bottle"', '"ball"'), names)
    assert "3 objects" in capsys.readouterr().out
    assert names["cloud"].shape[1:] == (3,) and names["gels"].shape == (4, 100, 100, 3)
    assert [len(site) > 0 for site in names["sites"]] == names["touched"].tolist()


def test_sensors_and_sizes_are_those_of_the_packages_that_make_the_data():
    robot = hand.allegro()
    assert tuple(robot.sensor_names) == SENSOR_NAMES
    assert f"({len(robot.joint_link)})" in SYMBOLS["j"]
    assert f"({touch.RESOLUTION})" in SYMBOLS["r"]
    assert f"({vision.paper_camera().size})" in SYMBOLS["p"]
    assert f"({views.COUNT})" in SYMBOLS["v"] and f"({views.SIZE})" in SYMBOLS["q"]


@pytest.mark.parametrize(
    ("shape", "message"),
    [
        ((2, 3, 7), r"array 'a': shape \(o, p, p, 7\) expected, but it is \(2, 3, 7\)"),
        ((2, 3, 3, 7, 1), r"array 'a': shape \(o, p, p, 7\) expected"),
        ((2, 3, 3, 6), r"array 'a': shape \(o, p, p, 7\) expected"),
        ((2, 5, 3, 7), "array 'a' has shape .*, so p = 3, but 'a' has p = 5"),
    ],
)
def test_shapes_that_disagree_are_refused(shape, message):
    spec = StoreSpec(STAGES["vision"], {"a": ArraySpec("a", ("o", "p", "p", 7), "uint8", 1, 0, "", "")})
    with pytest.raises(StoreError, match=message):
        check_headers(Path("a.zarr"), spec, {"a": (shape, np.dtype("uint8"))})
    check_headers(Path("a.zarr"), spec, {"a": ((2, 3, 3, 7), np.dtype("uint8"))})
    check_headers(Path("a.zarr"), spec, {"a": ((0, 0, 3, 7), np.dtype("uint8"))})  # of a batch without objects


def test_the_table_is_read_once(monkeypatch):
    tables, read = [], csv.DictReader
    monkeypatch.setattr(csv, "DictReader", lambda lines: tables.append(lines) or read(lines))
    assert runpy.run_path(contract.__file__)["CONTRACT"].keys() == CONTRACT.keys()
    assert len(tables) == 1


def test_chunks_are_records():
    spec = ArraySpec("a", ("o", "g", 4, "r"), "float32", 3, np.inf, "", "")
    assert spec.chunk((2, 5, 4, 100)) == (1, 1, 1, 100)
    assert spec.chunk((0, 0, 4, 0)) == (1, 1, 1, 1)


def test_the_package_offers_what_it_names():
    for name in palpate.store.__all__:
        assert getattr(palpate.store, name) is not None
    with pytest.raises(AttributeError, match="palpate.store"):
        palpate.store.nothing  # noqa: B018
