"""The table of stages: what follows from its rows, against what is written elsewhere."""

from palpate.stages import DATASET_STAGES, DATASET_STORES, STAGES
from palpate.store import CONTRACT


def test_rows_stand_under_their_names_after_what_they_read():
    names = list(STAGES)
    for name, stage in STAGES.items():
        assert stage.name == name and all(names.index(each) < names.index(name) for each in stage.reads)


def test_an_object_is_rejected_by_what_its_stage_goes_back_to():
    assert {name: stage.rejecting for name, stage in STAGES.items()} == {
        "meshes": ("meshes",),
        "surface": ("surface", "meshes"),
        "grasps": ("grasps", "surface", "meshes"),
        "touch": ("touch", "grasps", "surface", "meshes"),
        "frames": ("grasps", "surface", "meshes"),
        "hold": ("grasps", "surface", "meshes"),
        "frame_images": ("frame_images", "grasps", "surface", "meshes"),
        "press": ("press", "surface", "meshes"),
        "charts": ("touch", "grasps", "surface", "meshes"),
        "vision": ("vision", "grasps", "surface", "meshes"),
        "views": ("views", "meshes"),
        "templates": ("surface", "meshes"),
        "rings": ("touch", "grasps", "surface", "meshes"),
    }


def test_lists_of_stages():
    asked = ("frames", "hold", "press", "frame_images")
    assert {*DATASET_STAGES} == {"released", "meshes", "surface", "grasps", "touch", "vision", *asked}
    assert DATASET_STORES == ("surface", "grasps", "touch", "frames", "hold", "press", "vision", "frame_images")
    assert [each.name for each in STAGES.values() if not each.is_asked({})] == [*asked]
    assert STAGES["frames"].is_asked({"frames": {"count": 20}})
    assert set(CONTRACT) == set(STAGES) - {"meshes"}
    assert STAGES["grasps"].path("batch-0001") == CONTRACT["grasps"].path("batch-0001") == "grasps/batch-0001.h5"
    assert STAGES["meshes"].path("batch-0001") == "meshes/batch-0001"


def test_tests_of_a_group_share_a_process(request):
    """pytest-xdist reads groups behind an @ of a test's id. Without them a run that tests share is made twice."""
    if request.config.getoption("loadgroup", default=False):
        assert request.node.nodeid.endswith("@test_stages.py")
