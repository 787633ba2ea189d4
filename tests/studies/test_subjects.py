"""Which objects reports look at."""

import pytest

from studies.subjects import pick


@pytest.fixture
def run(tmp_path):
    """Two batches; b of the first is rejected at touch, d of the second has no meshes."""
    (tmp_path / "catalogue").mkdir()
    (tmp_path / "rejected/touch").mkdir(parents=True)
    batches = {"batch-0000": {"a": "knife", "b": "knife", "c": "knife"}, "batch-0001": {"d": "rifle", "e": "rifle"}}
    for batch, objects in batches.items():
        rows = "".join(f"{name},{kind},train,{batch}\n" for name, kind in objects.items())
        (tmp_path / f"catalogue/{batch}.csv").write_text(f"object,class,split,batch\n{rows}")
        for name in set(objects) - {"d"}:
            (tmp_path / f"meshes/{batch}/{name}").mkdir(parents=True)
            (tmp_path / f"meshes/{batch}/{name}/mesh.json").write_text("{}")
    (tmp_path / "rejected/touch/batch-0000.csv").write_text("object,stage,reason\nb,touch,too smooth\n")
    return tmp_path


@pytest.mark.parametrize(
    ("objects", "batches", "names"),
    [
        (1, None, ["a"]),
        (2, None, ["a", "e"]),  # classes in turn
        (9, None, ["a", "e", "c"]),
        (2, ["batch-0000"], ["a", "c"]),
    ],
)
def test_usable_objects_a_class_in_turn(run, objects, batches, names):
    selected = pick(run, objects, batches)
    assert [each.name for each in selected] == names
    assert all((each.folder / "mesh.json").is_file() for each in selected)


def test_nothing_usable_is_an_error_that_says_where_to_look(run):
    with pytest.raises(ValueError, match="see .*rejected"):
        pick(run, 3, ["batch-0009"])
