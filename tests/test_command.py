"""The command `palpate`, called as from a terminal; `reconstruct` is in tests/learning/test_reconstruct.py."""

import re
import shutil
import subprocess
import sys
import tarfile

import pytest

import palpate
from palpate.command import error_message, main
from tests.store.conftest import *  # noqa: F403


def test_version_and_help(capsys):
    for argument, said in (("--version", f"palpate {palpate.__version__}\n"), ("--help", "palpate export")):
        with pytest.raises(SystemExit) as end:
            main([argument])
        assert end.value.code == 0 and said in capsys.readouterr().out
    with pytest.raises(SystemExit) as end:
        main(["vieww", "x"])
    assert end.value.code == 2 and "choose from" in capsys.readouterr().err


def test_help_and_info_load_no_engine(built):
    code = (
        "import sys; from palpate.command import main; main(['info', sys.argv[1]]); "
        "sys.exit(any(name in sys.modules for name in ('torch', 'mujoco', 'bpy', 'matplotlib')))"
    )
    done = subprocess.run([sys.executable, "-c", code, str(built)], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr


def test_output_that_nobody_reads_ends_quietly(built):
    command = [sys.executable, "-m", "palpate.command", "info", str(built)]
    process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    process.stdout.close()  # as `head` does once it has its lines
    assert process.stderr.read() == "" and process.wait() == 1


def test_info_of_a_run(built, capsys):
    assert main(["info", str(built)]) == 0
    said = capsys.readouterr().out
    assert f"{built}: 3 objects" in said and "ball: train 1, validation 1" in said
    assert "stages: surface, grasps, touch, vision\nmodels: none" in said


def test_view_writes_pages(run, capsys):
    assert main(["view", str(run), "ball-0000", "--grasps", "1"]) == 0
    assert capsys.readouterr().out.split() == [f"{run}/viewer/ball-0000.html", f"{run}/viewer/ball-0000.glb"]
    assert not (run / "index.html").exists()
    assert main(["view", str(run)]) == 0
    assert capsys.readouterr().out.split() == [f"{run}/index.html"]
    links = re.compile(r'href="([^"]*html)"')
    pages = {f"viewer/{name}.html" for name in ("ball-0000", "ball-0002", "block-0000")}
    assert set(links.findall((run / "index.html").read_text())) == pages
    (run / "viewer/ball-0002.html").unlink()
    assert main(["view", str(run), "ball-0000"]) == 0  # which the page of the run links then
    assert set(links.findall((run / "index.html").read_text())) == pages - {"viewer/ball-0002.html"}
    assert main(["view", str(run), "--all", "--output", str(run / "pages")]) == 0
    found = sorted(path.name for path in (run / "pages").glob("*.html"))
    assert found == ["ball-0000.html", "ball-0002.html", "block-0000.html", "index.html"]
    assert set(links.findall((run / "pages/index.html").read_text())) == set(found[:3])


def test_export_writes_a_new_folder_and_never_into_another(built, tmp_path, capsys):
    assert main(["export", str(built), str(tmp_path / "web"), "--arrays", "reading", "--license", "mit"]) == 0
    assert capsys.readouterr().out == f"{tmp_path / 'web'}: 6 grasps\n"
    with tarfile.open(tmp_path / "web/train-000000.tar") as tar:
        assert tar.getnames()[:2] == ["00000000.json", "00000000.reading.0.png"]
    assert main(["export", str(built), str(tmp_path / "web")]) == 1
    assert "exists: name a new folder, or remove it" in capsys.readouterr().err


def test_validate_checks_and_says_what_it_found(run, capsys):
    assert main(["validate", str(run)]) == 0
    assert "checks, 4 objects: passed" in capsys.readouterr().out
    shutil.rmtree(run / "touch/batch-0001.zarr/depth/c")
    assert main(["validate", str(run)]) == 1
    said = capsys.readouterr().err
    assert "failed" in said and "depth/c/0/0/0/0/0 is missing" in said


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["info", "nowhere"], "nowhere: no such run: there is no run in ."),
        (["info", "{run}/catalogue.csv"], "{run}/catalogue.csv is a file: name a run's folder"),
        (["validate", "{run}/touch"], "{run}/touch is no run itself, but within the run {run}: name that"),
        (
            ["validate", "{run}/../empty"],
            "{run}/../empty/catalogue.csv does not exist, and {run}/../empty is empty: name a run's folder",
        ),
        (["view", "{run}/../nope"], "/nope: no such run: runs in {run}/.. are small"),
        (["info", "{run}/.."], "{run}/..: no run itself: runs in {run}/.. are small"),
        (
            ["export", "{run}", "{run}/out", "--license", "cc-by-5"],
            "'cc-by-5' is no licence of SPDX, such as CC-BY-4.0",
        ),
        (["view", "{run}", "bal-0000"], "'bal-0000' is not among the 3 objects"),
        (["view", "{run}", "ball-0000", "--grasps", "7"], "ball-0000 has no grasp 7: it has 2"),
        (["view", "{run}", "ball-0000", "--model", "charts"], "no experiment 'charts' is trained in"),
        (["view", "{run}", "--model", "charts"], "--model: name an object, or give --all"),
        (["export", "{run}", "{run}/out", "--arrays", "gel"], "array of grasps: 'gel' is not one of"),
    ],
)
def test_errors_are_one_line(built, arguments, said, capsys):
    (built.parent / "empty").mkdir(exist_ok=True)
    assert main([each.format(run=built) for each in arguments]) == 1
    printed = capsys.readouterr().err
    assert said.format(run=built) in printed and printed.count("\n") == 1
    assert not (built / "out").exists() and not (built / "viewer").exists()


def test_a_missing_engine_is_named_with_the_extra_that_brings_it():
    error = ModuleNotFoundError("No module named 'torch.nn'", name="torch.nn")
    assert error_message(error) == "No module named 'torch.nn': pip install 'palpate[models]' brings it"
    assert error_message(ModuleNotFoundError("No module named 'x'", name="x")) == "No module named 'x'"
