import subprocess
import sys

import pytest

from palpate.vision import system


def python(code, **environment):
    return subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, env=environment or None)


def test_nothing_is_missing_where_blender_runs():
    assert system.missing_libraries() == {}
    assert system.main([]) == 0


def test_missing_libraries_are_named_with_the_command(monkeypatch, capsys):
    monkeypatch.setitem(system.PACKAGES, "libnowhere.so.7", "libnowhere7")
    assert system.missing_libraries() == {"libnowhere.so.7": "libnowhere7"}
    assert system.main([]) == 1
    output = capsys.readouterr()
    assert "libnowhere.so.7" in output.err
    assert output.out.strip() == "apt-get install --yes --no-install-recommends libnowhere7"


def test_checking_the_system_imports_no_blender():
    code = "import sys, palpate.vision.system as s; s.missing_libraries(); sys.exit('bpy' in sys.modules)"
    assert python(code).returncode == 0


@pytest.mark.parametrize(
    ("error", "library", "advice"),
    [
        ("libnowhere.so.7: cannot open shared object file", "libnowhere.so.7", "apt-get install"),
        ("__init__.so: undefined symbol: rtcNewScene", "libc.so.6", "palpate.vision.blender.load() before"),
        ("No module named 'bpy'", "libc.so.6", "envs/requirements.txt"),
    ],
)
def test_import_error_says_what_to_do(tmp_path, error, library, advice):
    (tmp_path / "bpy.py").write_text(f"raise ImportError({error!r})")
    code = (
        f"import sys; sys.path.insert(0, {str(tmp_path)!r})\n"
        "from palpate.vision import blender, system\n"
        f"system.PACKAGES[{library!r}] = 'package-with-it'\n"
        "blender.load()"
    )
    message = python(code).stderr.strip().splitlines()[-1]
    assert message.startswith("ImportError: Blender can't start") and advice in message
    assert ("package-with-it" in message) == (library == "libnowhere.so.7")


def test_camera_and_plain_data_need_no_blender():
    code = "import sys, palpate.vision as v; v.paper_camera().rays(); sys.exit('bpy' in sys.modules)"
    assert python(code).returncode == 0
