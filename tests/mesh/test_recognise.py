"""What is no mesh is named by its suffix or its content, with what to do."""

import io
import zipfile

import pytest

from palpate.batch import UnusableObject
from palpate.mesh import FORMATS
from palpate.mesh.load import load
from palpate.named_files import UNREAD, what_it_is
from tests.mesh import nasty, written
from tests.mesh.reading import CASES

IGES = b"a part".ljust(72) + b"S      1\n" + b"1H,,1H;".ljust(72) + b"G      1\n"


def archive(name: str) -> bytes:
    """Zipped: of a fixed time, since tests are named by it."""
    file = io.BytesIO()
    with zipfile.ZipFile(file, "w") as made:
        made.writestr(zipfile.ZipInfo(name), b"v 0 0 0\n")
    return file.getvalue()


@pytest.mark.parametrize(
    ("file", "says"),
    [
        ("lfs.obj", "a Git LFS pointer.*git lfs pull"), ("lfs.glb", "a Git LFS pointer.*git lfs pull"),
        ("page.stl", "an HTML page"), ("part.step", "STEP: solids, not triangles: export it"),
        ("scene.fbx", "FBX: not read"), ("scene.usdz", "USD: not read"), ("scene.wrl", "VRML: not read"),
        ("step_named.stl", "STEP by its content: solids"),
    ],
)  # fmt: skip
def test_cases(file, says):
    with pytest.raises(UnusableObject, match=says) as error:
        load(CASES / "wrong-formats" / file)
    assert file in str(error.value) and "\n" not in str(error.value)


@pytest.mark.parametrize(
    ("content", "says"),
    [
        (b"version https://git-lfs.github.com/spec/v1\noid sha256:12\nsize 1\n", "Git LFS"),
        (b"\xef\xbb\xbf  <!DOCTYPE html><html>", "HTML page"), (b"\n<HTML><body>", "HTML page"),
        (b'<?xml version="1.0"?>\n<!-- a\nb -->\n<Error><Code>AccessDenied</Code>', "message of a server"),
        (b'{"message": "Not Found"}', "message of a server"), (b"ISO-10303-21;\nHEADER;", "STEP"), (IGES, "IGES"),
        (b"Kaydara FBX Binary  \0", "FBX"), (b"; FBX 7.3.0 project file", "FBX"), (b"#usda 1.0\n", "USD"),
        (b"PXR-USDC\0", "USD"), (b"BLENDER-v300", "Blender"), (b"#VRML V2.0 utf8\n", "VRML"),
        (archive("a.obj"), "unpack"), (b"\x1f\x8b\x08\0", "unpack"),
        (b"Rar!\x1a\x07", "unpack"), (b"", "empty"), (b" \n", "empty"), (bytes(3000), "zeros"),
    ],
)  # fmt: skip
@pytest.mark.parametrize("suffix", FORMATS)
def test_contents_of_other_files(tmp_path, content, says, suffix):
    path = tmp_path / f"a.{suffix}"
    path.write_bytes(content)
    if suffix == "3mf" and content[:2] == b"PK":
        assert what_it_is(path) == ""
        return
    with pytest.raises(UnusableObject, match=says):
        load(path)


LOOKS = {"dae": {"colour": (1, 0, 0)}}


@pytest.mark.parametrize("suffix", FORMATS)
def test_a_mesh_under_another_suffix_is_told_and_under_its_own_is_none(tmp_path, suffix):
    path = written.write(tmp_path, suffix, **LOOKS.get(suffix, {}))
    assert what_it_is(path) == ""
    for other in set(FORMATS) - {suffix}:
        renamed = tmp_path / f"b.{other}"
        renamed.write_bytes(path.read_bytes())
        known = suffix != "stl"  # a binary STL begins with anything
        assert (f"rename it to .{suffix}" in what_it_is(renamed)) == known


def test_no_mesh_is_taken_for_another_thing(tmp_path):
    for name, path in nasty.usable(tmp_path).items():
        assert what_it_is(path) == "", name
    for path in CASES.rglob("*"):
        if path.suffix.lower()[1:] in FORMATS and path.parent.name != "wrong-formats":
            assert what_it_is(path) == "", path


def test_the_table_has_no_format_that_is_read():
    assert not {f".{suffix}" for suffix in FORMATS} & set(UNREAD)
    assert all(suffix == suffix.lower() and suffix[0] == "." for suffix in UNREAD)
