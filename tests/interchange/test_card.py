"""The data card: its header as YAML, its text as Markdown."""

import html
import json
import re

import numpy as np
import pytest
import yaml

import palpate
from palpate.dataset.run import Run
from palpate.dataset.validation import check_files, combine_validation, write_findings
from palpate.interchange import export
from palpate.interchange.card import without_folders
from palpate.store import CONTRACT, StoreError, read, write
from tests.store.conftest import ATTRIBUTES

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
    export(palpate.Dataset(run), tmp_path / "out", arrays=["reading", "depth"], licence="cc-by-4.0", source="my mugs")
    text = (tmp_path / "out/README.md").read_text()
    _, header, body = text.split("---\n", 2)
    header = yaml.safe_load(header)
    assert header["license"] == "cc-by-4.0" and header["size_categories"] == ["n<1K"]
    patterns = {each["split"]: each["path"] for each in header["configs"][0]["data_files"]}
    for split, pattern in patterns.items():
        assert [path.name for path in (tmp_path / "out").glob(pattern)] == [f"{split}-000000.tar"]
    for line in (
        "6 simulated grasps of 3 objects",
        "- Licence of the data: [CC-BY-4.0](https://spdx.org/licenses/CC-BY-4.0).",
        "- Source of the meshes: my mugs.",
        "| ball | 1 | 1 | 0 |",
        "| block | 0 | 0 | 1 |",
        "2 grasps an object.",
        "| `reading` | (4, 100, 100, 3) | uint8 | RGB | sensor, row, column, colour | ",
        " | `reading.0.png` to `reading.3.png` | ",
        "| `depth` | (4, 100, 100) | float32 | m | sensor, row, column | `depth.npy` |",
        "- world: right-handed, z up; ",
        "that of a sensor that touched nothing is `empty_reading.png`",
        "Order of the axis `sensor`: index, middle, ring, thumb. Order of the axis `link`: palm, index_0, ",
        "| 4 | middle_0 | middle_0 | palm | turns | -0.47 to 0.47 rad |  |",
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


def validate(run):
    """Reports of a validation that passed, as the workflow writes them."""
    opened, tables, findings = Run(run), run / "reports/validation", []
    tables.mkdir(parents=True, exist_ok=True)
    for batch in opened.batches:
        found = check_files(opened, batch)
        write_findings(tables / f"{batch}.csv", found)
        findings += found
    combine_validation(findings, run).to_csv(run / "reports/validation.csv", index=False)


def checks_of(run, folder, **options):
    export(palpate.Dataset(run), folder, **options)
    return (folder / "README.md").read_text().split("## Checks\n\n")[1].split("\n\n")[0]


def test_all_passed_is_said_of_files_that_were_checked_only(run, tmp_path):
    assert checks_of(run, tmp_path / "a", arrays=["success"]) == "The run was not validated."
    validate(run)
    assert re.fullmatch(r"\d+ checks of files and values: all passed\.", checks_of(run, tmp_path / "b"))
    path = run / CONTRACT["touch"].path("batch-0001")
    arrays = read(path)
    write(path, "touch", arrays | {"position": arrays["position"] + 1e-9}, ATTRIBUTES)
    said = checks_of(run, tmp_path / "c")
    assert "passed" not in said and "not of these files: touch/batch-0001 are new or have changed since" in said
    assert "all passed" in checks_of(run, tmp_path / "d", arrays=["occluded"])  # of a stage that is as it was
    (run / "reports/validation/batch-0000.csv").unlink()
    assert "passed" not in checks_of(run, tmp_path / "e", arrays=["occluded"])


@pytest.mark.parametrize(
    ("given", "stated", "header", "described"),
    [
        ("mit", "[MIT](https://spdx.org/licenses/MIT)", {"license": "mit"}, "https://spdx.org/licenses/MIT"),
        ("unknown", "unknown", {"license": "unknown"}, "unknown"),
        (
            "mit OR cc0-1.0",
            "MIT OR CC0-1.0",
            {"license": "other", "license_name": "MIT OR CC0-1.0"},
            "MIT OR CC0-1.0",
        ),
        (
            "LicenseRef-ShapeNet",
            "LicenseRef-ShapeNet",
            {"license": "other", "license_name": "LicenseRef-ShapeNet"},
            "LicenseRef-ShapeNet",
        ),
    ],
)
def test_licences_are_those_of_spdx(built, tmp_path, given, stated, header, described):
    export(palpate.Dataset(built), tmp_path / "out", arrays=["penetration"], licence=given)
    _, found, body = (tmp_path / "out/README.md").read_text().split("---\n", 2)
    found = yaml.safe_load(found)
    assert {key: found[key] for key in found if key.startswith("license")} == header
    assert f"- Licence of the data: {stated}.\n" in body
    assert json.loads((tmp_path / "out/croissant.json").read_text())["license"] == described


@pytest.mark.parametrize("given, hint", [("cc-by", "cc-by-"), ("apache2", "apache-2.0"), ("CC BY 4.0", "cc-by-4.0")])
def test_another_licence_is_an_error_with_the_nearest(built, tmp_path, given, hint):
    with pytest.raises(ValueError, match=f"'{given}' is no licence of SPDX.*did you mean .*{hint}"):
        export(palpate.Dataset(built), tmp_path / "out", licence=given)
    assert not list(tmp_path.iterdir())
