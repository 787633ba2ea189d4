"""The page of a run: what it says of files whose content is known, and how it stands in a real browser."""

import csv
import json
import os
import re
import shutil
import subprocess
import sys
from html import escape

import pandas as pd
import pytest
from PIL import Image

import palpate
from palpate.results.products import caption
from palpate.results.tables import write_table
from palpate.viewer import run_page
from tests.viewer.browser import in_browser, needs_browser

EVIL = "<img src=x onerror=\"window.hacked='yes'\"><script>window.hacked='yes'</script>'\"&{{ 7 * 7 }}"


def benchmark(path, seconds, memory):
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(f"s\th:m:s\tmax_rss\n{seconds}\t0:00:01\t{memory}\n")


@pytest.fixture(scope="module")
def whole(built, tmp_path_factory):
    """The small run with tables, figures, a training, times, a failure and warnings."""
    run = shutil.copytree(built, tmp_path_factory.mktemp("page") / "small")
    table = pd.DataFrame(
        {
            "class": ["ball", "block", "total"],
            "average": [9.5, 10.25, 0.125],
            "average_low": [9.0, 8.0, None],
            "average_high": [9.75, 12.0, None],
            "average_paper": [None, 1.5, None],
        }
    )
    table.attrs |= {"decimals": 3, "note": "A note with `code`."}
    write_table(table, run / "tables/input_modalities.csv")
    methods = ["charts (paper)"] * 3 + ["template (ours)"]  # the head counts the paper's method
    claims = {
        "method": methods,
        "claim": ["Touch helps", "Charts help", "More helps", "Touch helps"],
        "section": "5.10",
    }
    claims |= {"measured": [-1.5, 2.0, 0.1, -1.0], "verdict": ["holds", "does not hold", "undecided", "holds"]}
    write_table(pd.DataFrame(claims), run / "tables/claims.csv")
    (run / "figures").mkdir()
    for name in ("data_point", "multi_grasp", "atlas"):
        Image.effect_noise((1800, 600), 60).save(run / f"figures/{name}.png")
    folder = run / "models/charts_occluded/seed-0"
    folder.mkdir(parents=True)
    record = {"validation_loss": 1.25, "best_step": 20, "steps": 30, "seconds": 75.0}
    (folder / "training.json").write_text(json.dumps(record))
    (folder / "history.csv").write_text(
        "step,seconds,train_loss,validation_loss,rate\n10,1,100,10,1\n20,2,10,1,1\n30,3,1,10,1\n"
    )
    for batch, seconds in (("batch-0000", 60), ("batch-0001", 2.5)):
        benchmark(run / f"benchmarks/grasps/{batch}.tsv", seconds, 300 + seconds)
    benchmark(run / "benchmarks/claims.tsv", 3, 100)
    benchmark(run / "benchmarks/atlas.tsv", 9, 200)
    (run / "logs/catalogue").mkdir(parents=True)
    (run / "logs/catalogue.log").write_text(
        "2026-01-02 03:04:05,678 WARNING drill turned grey\n2026-01-02 03:04:05,678 INFO not this\n"
        "2026-01-02 03:04:05,678 WARNING grasps 1/2: ball-0001 rejected: nor this\n"
    )
    (run / "config.yaml").write_text("run: small\nseed: 7\nsource: {kind: folder, path: /meshes}\n")
    last = {"ended": "2026-01-02 03:04", "command": "snakemake dataset", "jobs": 9, "seconds": 65}
    failure = ["touch", "touch/batch-0001.zarr", str(run / "logs/touch.log"), "MemoryError: too little"]
    last |= {"failures": [failure], "versions": {"palpate": palpate.__version__, "mujoco": "3"}}
    (run / "last_run.json").write_text(json.dumps(last))
    run_page(run)
    return run


READ = """(found) => {
  found.width = innerWidth;
  found.wide = document.documentElement.scrollWidth;
  found.hacked = window.hacked ?? null;
  found.anchors = [...document.querySelectorAll("nav a")].map((x) => x.getAttribute("href"));
  found.missing = found.anchors.filter((x) => !document.querySelector(x));
  found.facts = Object.fromEntries([...document.querySelectorAll(".facts div")].map((x) =>
    [x.querySelector("dt").innerText, x.querySelector("dd").innerText]));
  found.broken = [...document.images].filter((x) => !x.complete || !x.naturalWidth).length;
  found.scripts = document.scripts.length;
  const rows = (place) => [...document.querySelectorAll(`${place} tbody tr`)].map((x) =>
    [...x.cells].map((y) => y.innerText.trim()));
  const places = ["objects", "rejected", "table-input_modalities", "claims", "training", "time"];
  found.rows = Object.fromEntries(places.map((x) => [x, rows("#" + x)]));
  found.heads = [...document.querySelectorAll("#table-input_modalities th")].map((x) => x.innerText);
  found.text = document.body.innerText;
  found.curve = [...document.querySelectorAll("#training polyline")].map((x) => x.getAttribute("points"));
  found.links = [...document.querySelectorAll(".objects a")].map((x) => decodeURIComponent(x.getAttribute("href")));
  found.outside = [...document.querySelectorAll("*")].filter((x) => {
    if (x.closest(".box, nav, pre, svg")) return false;
    const { left, right } = x.getBoundingClientRect();
    return left < -0.5 || right > innerWidth + 0.5;
  }).map((x) => x.outerHTML.slice(0, 80));
"""


# Clicks on the heads of a table, and words in the filter of objects.
SORT = """
  const table = document.querySelector("#table-input_modalities table");
  const names = () => [...table.tBodies[0].rows].map((row) => row.cells[0].innerText);
  const click = (column) => {
    table.tHead.rows[0].cells[column].querySelector("button").click();
    return names();
  };
  found.orders = [names(), click(1), click(1), click(2), click(0), click(0)];
  found.state = table.tHead.rows[0].cells[0].getAttribute("aria-sort");
  const shown = () => [...document.querySelectorAll("figure[data-words]:not([hidden])")].map((x) =>
    x.innerText.split("\\n")[0]);
  found.all = shown();
  const filter = document.getElementById("filter");
  filter.value = "ball VALID";
  filter.dispatchEvent(new Event("input"));
  found.some = shown();
  found.count = document.getElementById("count").textContent;
}"""


@needs_browser
def test_the_page_says_what_the_files_hold_is_sorted_by_a_click_and_filtered(whole, tmp_path):
    found = in_browser(whole / "index.html", tmp_path, READ + SORT)
    assert not found["broken"] and not found["missing"] and not found["outside"] and found["wide"] == found["width"]
    # Of four objects, one of which was rejected: two balls (train, validation) and a block (test).
    expected = [
        ["ball", "1", "1", "0", "2", "1"],
        ["block", "0", "0", "1", "1", "0"],
        ["total", "1", "1", "1", "3", "1"],
    ]
    assert found["rows"]["objects"] == expected
    assert found["rows"]["rejected"] == [["ball-0001", "grasps", "too few grasps"]]
    assert found["heads"] == ["class", "average", "average paper"]
    modalities = [
        ["ball", "9.500 [9.000, 9.750]", "–"],
        ["block", "10.250 [8.000, 12.000]", "1.500"],
        ["total", "0.125", "–"],
    ]
    assert found["rows"]["table-input_modalities"] == modalities
    assert [row[:4] for row in found["rows"]["claims"]] == [
        ["charts (paper)", "Touch helps", "holds", "5.10"],
        ["charts (paper)", "Charts help", "does not hold", "5.10"],
        ["charts (paper)", "More helps", "undecided", "5.10"],
        ["template (ours)", "Touch helps", "holds", "5.10"],
    ]
    assert found["rows"]["training"] == [["charts_occluded/seed-0", "", "1.250", "20", "30", "1 min 15 s"]]
    # The losses fall from 100 to 1 and from 10 to 1 and back, on a scale of logarithms from 1 to 100.
    assert found["curve"] == ["50.0,0.0 100.0,17.0 150.0,34.0", "50.0,17.0 100.0,34.0 150.0,17.0"]
    times = [["grasps", "2", "1 min 2 s", "1 min 0 s", "360"], ["figures", "1", "9 s", "9 s", "200"]]
    assert found["rows"]["time"] == [*times, ["tables", "1", "3 s", "3 s", "100"]]
    facts = {"objects used": "3", "classes": "2", "rejected": "1", "of the paper's claims hold": "1 of 3"}
    assert facts.items() <= found["facts"].items()
    said = [
        "1 job failed",
        "MemoryError: too little",
        "drill turned grey",
        "A note with code.",
        "1 hold",
        "1 undecided",
    ]
    said += ["seed", "/meshes", "snakemake dataset, 9 jobs in 1 min 5 s", f"palpate {palpate.__version__}, mujoco 3"]
    assert not [each for each in said if each not in found["text"]] and "nor this" not in found["text"]
    assert " ".join(caption("tables", "input_modalities").replace("`", "").split()) in found["text"].replace("\n", " ")
    # The total stays at the end, as do missing values before it; 9.5 is less than 10.25, as text it is not.
    rising, falling = ["ball", "block", "total"], ["block", "ball", "total"]
    assert found["orders"] == [rising, rising, falling, falling, rising, falling] and found["state"] == "descending"
    assert found["all"] == ["ball-0000", "block-0000", "ball-0002"]
    assert found["some"] == ["ball-0002"] and found["count"] == "1 of 3"


@needs_browser
def test_the_page_fits_a_phone(whole, tmp_path):
    """Nothing but tables, which scroll in their boxes, and the line of sections is wider than the screen."""
    frame = whole / "phone.html"  # a window of chromium is never narrower than 500 pixels
    inside = (
        f'<iframe width="390" height="844" style="border: 0" srcdoc="{escape((whole / "index.html").read_text())}">'
    )
    frame.write_text(f"""<body><script>const ready = () => document.body.dataset.state = "ready";</script>
        {inside.replace("srcdoc", 'onload="ready()" srcdoc')}</iframe></body>""")
    steps = READ.replace("(found) => {", "(found) => ((window) => { const { document, innerWidth } = window;")
    steps += """found.boxes = [...document.querySelectorAll(".box")].map((x) =>
      [x.getBoundingClientRect().right, x.scrollWidth > x.clientWidth]);
    })(document.querySelector("iframe").contentWindow)"""
    found = in_browser(frame, tmp_path, steps)
    assert found["width"] == 390 and found["wide"] == 390 and not found["outside"]
    assert all(right <= 390 for right, _ in found["boxes"]) and any(scrolls for _, scrolls in found["boxes"])


def test_pictures_lead_to_pages_that_are_there_and_not_older_than_the_stores(run, tmp_path):
    def links():
        return re.findall(r'<a href="(viewer/[^"]+)">', (run / "index.html").read_text())

    run_page(run, object_pages=0)
    assert links() == [] and "palpate view" in (run / "index.html").read_text()
    run_page(run, object_pages=2)  # one of each class
    assert links() == ["viewer/ball-0000.html", "viewer/block-0000.html"]
    assert all((run / link).exists() and (run / link).with_suffix(".glb").exists() for link in links())
    before = (run / links()[0]).stat().st_mtime_ns
    run_page(run, object_pages=2)
    assert (run / links()[0]).stat().st_mtime_ns == before  # nothing was written again
    os.utime(run / "touch/batch-0000.zarr")  # as if it were made again
    run_page(run, object_pages=0)
    assert links() == []
    run_page(run, object_pages=1)
    assert links() == ["viewer/ball-0000.html"]


@needs_browser
def test_hostile_names_are_text(tmp_path):
    run = tmp_path / "a#b %41"
    (run / "tables").mkdir(parents=True)
    rows = [["object", "class", "split", "batch", "source", "checksum"]]
    name = EVIL.replace("/", "")
    rows += [
        [name, EVIL, "train", "batch-0000", EVIL, "0" * 64],
        ["bad", EVIL, "test", "batch-0000", "x.obj", "0" * 64],
    ]
    with open(run / "catalogue.csv", "w", newline="") as file:
        csv.writer(file, lineterminator="\n").writerows(rows)
    with open(run / "rejected.csv", "w", newline="") as file:
        csv.writer(file, lineterminator="\n").writerows([["object", "stage", "reason"], ["bad", "meshes", EVIL]])
    table = pd.DataFrame({"class": [EVIL], f"x{EVIL}": [1.5], "verdict": [EVIL]})
    table.attrs["note"] = f"{EVIL} `{EVIL}`"
    write_table(table, run / "tables/evil.csv")
    for folder in ("figures", "viewer", "logs"):
        (run / folder).mkdir()
    Image.new("RGB", (30, 20)).save(run / f"figures/{name}.png")
    (run / f"viewer/{name[:200]}.html").write_text("<title>there</title>")
    (run / "logs/x.log").write_text(f"2026-01-02 03:04:05,678 WARNING {EVIL}\n")
    (run / "config.yaml").write_text(f"run: x\nseed: {json.dumps(EVIL)}\n")
    last = {"ended": EVIL, "command": EVIL, "jobs": 1, "seconds": 1, "versions": {"palpate": EVIL}}
    (run / "last_run.json").write_text(json.dumps(last | {"failures": [[EVIL, EVIL, f"/{EVIL}", EVIL]]}))
    run_page(run)
    found = in_browser(run / "index.html", tmp_path, READ + "}", size=(390, 800))
    assert found["hacked"] is None and not found["broken"] and not found["outside"]
    assert found["scripts"] == 2  # the page's, and the probe
    assert found["rows"]["rejected"] == [["bad", "meshes", EVIL]]
    assert found["text"].count(EVIL) >= 10 and "49" not in found["text"]
    assert found["links"] == [f"viewer/{name}.html"] and (run / found["links"][0]).exists()


def test_a_run_in_part_and_a_damaged_one_have_a_page(run, tmp_path):
    empty = tmp_path / "empty"
    empty.mkdir()
    assert "catalogue.csv does not exist" in run_page(empty).read_text()
    for stage in ("vision", "grasps", "touch"):
        shutil.rmtree(run / stage)
    (run / "tables").mkdir()
    (run / "tables/broken.md").write_text("")
    write_table(pd.DataFrame({"class": ["ball"], "number": [3]}), run / "tables/good.csv")
    (run / "last_run.json").write_text("{")
    text = run_page(run).read_text()
    for said in ("no image", 'id="table-good"', "broken.md: not a table in Markdown", "JSONDecodeError"):
        assert said in text
    assert text.count('href="viewer/') == 3  # the meshes are there


def test_the_page_loads_no_engine(built, tmp_path):
    code = (
        "import sys; from palpate.viewer import run_page; run_page(*sys.argv[1:], object_pages=0); "
        "sys.exit(any(name in sys.modules for name in ('torch', 'mujoco', 'bpy', 'trimesh', 'igl', 'matplotlib')))"
    )
    done = subprocess.run([sys.executable, "-c", code, built, tmp_path / "x.html"], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr


def test_a_large_run_has_a_small_page(run):
    """Of 4,000 objects, rejections and warnings some are shown, and how many more there are is said."""
    header, *rows = (run / "catalogue.csv").read_text().splitlines()
    kinds = [
        f"kind{number % 40}-{number:04d},kind{number % 40},train,batch-0002,x.obj,{'0' * 64}" for number in range(4000)
    ]
    (run / "catalogue.csv").write_text("\n".join([header, *rows, *kinds]) + "\n")
    lost = [f"kind1-{number:04d},meshes,no faces" for number in range(1, 4000, 40)]
    many = [f"ball-0001,grasps,{'x' * 50} {number}" for number in range(3000)]
    (run / "rejected.csv").write_text("\n".join(["object,stage,reason", *lost, *many]) + "\n")
    (run / "logs").mkdir()
    (run / "logs/a.log").write_text("".join(f"2026-01-02 03:04:05,6 WARNING lost {number}\n" for number in range(2000)))
    text = run_page(run, object_pages=0).read_text()
    assert len(text) < 1_000_000
    names = re.findall(r'<figure data-words="(\S+) ([^",]+), \w+">', text)
    assert (
        len(names) == 300 and len({kind for _, kind in names}) == 41
    )  # of all classes but that without a usable object
    assert "300 of 3903 objects" in text and "The first 500 of 3100 rows" in text and "And 1900 more" in text


def test_the_page_needs_no_network_and_figures_beyond_a_size_stay_files(whole, tmp_path, monkeypatch):
    text = (whole / "index.html").read_text()
    assert not re.search(r"""(?:src|href)\s*=\s*["']?(?:https?:)?//|@import|url\(""", text)
    assert text.count('src="data:image/webp;base64,') == 3 + 3  # figures and objects
    monkeypatch.setattr("palpate.viewer.index.EMBEDDED", 1)
    page = run_page(whole, tmp_path / "elsewhere/page.html", object_pages=0).read_text()
    sources = re.findall(r'<img src="((?!data:)[^"]+)"', page)
    assert len(sources) == 2 and all((tmp_path / "elsewhere" / source).exists() for source in sources)
