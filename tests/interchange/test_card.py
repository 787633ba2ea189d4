"""The data card: its header as YAML, its text as Markdown."""

import html
import json
import re

import numpy as np
import pytest
import yaml

import palpate
from palpate.interchange import export
from palpate.interchange.card import without_folders
from palpate.store import StoreError

HOSTILE = "<script>alert('x')</script> | `a` **b** [c](javascript:d) <!-- e ![f](//g.h/i) &amp; www.j.k m@n.o \u202e#"


def test_the_card_says_what_is_in_it(run, tmp_path):
    config = {"run": "small", "results": "/home/me/results", "source": {"kind": "folder", "path": "/home/me/mugs"}}
    (run / "config.yaml").write_text(yaml.safe_dump(config))
    (run / "reports").mkdir()
    (run / "reports/validation.csv").write_text("check,passed\nfiles,True\nfinite,False\n")
    (run / "last_run.json").write_text(json.dumps({"commit": "0123abc-dirty"}))
    (run / "figures").mkdir()
    for name in ("data_point", "examples_ball", "rings"):
        (run / f"figures/{name}.png").write_bytes(name.encode())
    export(palpate.Dataset(run), tmp_path / "out", arrays=["reading"], licence="cc-by-4.0", source="my mugs")
    text = (tmp_path / "out/README.md").read_text()
    _, header, body = text.split("---\n", 2)
    header = yaml.safe_load(header)
    assert header["license"] == "cc-by-4.0" and header["size_categories"] == ["n<1K"]
    patterns = {each["split"]: each["path"] for each in header["configs"][0]["data_files"]}
    for split, pattern in patterns.items():
        assert [path.name for path in (tmp_path / "out").glob(pattern)] == [f"{split}-000000.tar"]
    for line in (
        "6 simulated grasps of 3 objects",
        "- Licence of the data: cc-by-4.0.",
        "- Source of the meshes: my mugs.",
        "| ball | 1 | 1 | 0 |",
        "| block | 0 | 0 | 1 |",
        "2 grasps an object.",
        "| `reading` | (4, 100, 100, 3) | uint8 | RGB |",
        "| 1 | grasps | too few grasps |",
        "2 checks of files and values: 1 failed.",
        f"palpate {palpate.__version__}, ",
        f"numpy {np.__version__}",
        "Commit of palpate: 0123abc-dirty.",
    ):
        assert line in body, line
    linked = re.findall(r"!\[[^]]+\]\((figures/.*)\)", body)  # figures of the data, those that there are
    assert linked == ["figures/data_point.png", "figures/examples_ball.png"]
    assert [(tmp_path / "out" / name).read_text() for name in linked] == ["data_point", "examples_ball"]
    assert "path: mugs" in body and "/home/me" not in body  # nothing of this machine


def test_a_damaged_note_of_the_last_start_is_named(run, tmp_path):
    (run / "last_run.json").write_text("{")
    with pytest.raises(StoreError, match="last_run.json is damaged; remove it"):
        export(palpate.Dataset(run), tmp_path / "out", arrays=["reading"])
    assert not (tmp_path / "out").exists()


def test_what_comes_from_meshes_is_shown_as_it_is(run, tmp_path):
    for path in [run / "catalogue.csv", *(run / "catalogue").iterdir()]:
        path.write_text(path.read_text().replace(",ball,", f',"{HOSTILE}",'))
    reason = f"/home/me/scans/a.stl: texture /home/me/b c/d.png, ../e.png and ~/f.png missing {HOSTILE}"
    (run / "rejected.csv").write_text(f'object,stage,reason\nball-0001,grasps,"{reason}"\n')
    classes = [{"class": HOSTILE}, {"class": "```\n<b>"}]
    config = {"source": {"kind": HOSTILE, "path": "~/mugs"}, "classes": classes, "hand": "/home/me/hand.xml"}
    (run / "config.yaml").write_text(yaml.safe_dump(config))
    export(palpate.Dataset(run), tmp_path / "out", arrays=["success"])
    text = (tmp_path / "out/README.md").read_text()
    _, _, body = text.split("---\n", 2)
    assert "/home/me" not in text and "~/" not in text and "\u202e" not in text
    shown = " ".join(HOSTILE.replace("\u202e", "").split())
    cells = [line.strip("| ").split(" | ") for line in body.splitlines() if line.startswith("| ")]
    assert [shown, "1", "1", "0"] in [[html.unescape(cell) for cell in row] for row in cells]  # the class
    (reason,) = (row[2] for row in cells if row[:2] == ["1", "grasps"])
    assert html.unescape(reason) == f"texture b c/d.png, e.png and f.png missing {shown.replace('//g.h/', '')}"
    for text in (reason, cells[2][0]):  # what is left can't begin markup or a link
        assert not re.search(r"[][<>`*|!#:@\\~]|www\.|//", re.sub(r"&#\d+;", "", text))
    block = body.split("## Config\n\n")[1].splitlines()
    assert all(line.startswith("    ") or not line for line in block)  # code, whatever is in it
    config = yaml.safe_load("\n".join(line[4:] for line in block))
    assert config["classes"] == classes and (config["source"]["path"], config["hand"]) == ("mugs", "hand.xml")


@pytest.mark.parametrize(
    "text, expected",
    [
        ("can't read /a/b/c.png", "can't read c.png"),
        ("file:///a/b.png or ~me/c/d.png, '../../e/f.obj'", "b.png or d.png, 'f.obj'"),
        ("1/2 of n/a; m/s and textures/a.png", "1/2 of n/a; m/s and textures/a.png"),
    ],
)
def test_paths_lose_their_folders(text, expected):
    assert without_folders(text) == expected
