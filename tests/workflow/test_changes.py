"""A change of the config runs again what depends on it, and nothing else."""

from pathlib import Path

import pytest

STAGES = {"catalogue_batch", "catalogue", "meshes", "surface", "grasps", "touch", "vision", "table"}
AFTER_GRASPS = {"touch", "vision", "table"}
HANDS = Path(__file__).parents[2] / "config/hands"
WSG50 = {"mjcf": str(HANDS / "wsg50.xml"), "sensors": str(HANDS / "wsg50.yaml")}
OTHER_LIGHT = "{extends: digit, diffuse: 200, lights: [{direction: [0, 1, 1], colour: [1, 1, 1]}]}"
OTHER_RANGE = "{extends: digit, range: 0.024}"


def test_frames_are_added_to_a_run_that_stays_as_it_is(finished):
    """And nothing of them is in one that asks for none."""
    assert not list(finished.run.glob("*/*frame*")) and not list(finished.run.glob("*frame*"))
    jobs = finished.changed(frames={"count": 3, "images": 2}).jobs("dataset")
    added = {"frames", "frame_images", "animation"}
    assert {job.rule for job in jobs} == added | {"validate_batch", "validation", "rejected", "dataset"}
    assert finished.changed(frames={"count": 3}).planned("frames/batch-0000.zarr") == {"frames"}
    assert not list(finished.run.glob("hold*")) and not (finished.run / "tables/hold.csv").exists()
    assert finished.changed(hold={"test": True}).planned("tables/hold.csv") == {"hold", "table"}


@pytest.mark.parametrize(
    ("config", "first", "others"),
    [
        ({"vision": {"size": 64, "samples": 3, "device": "cpu"}}, "vision", set()),
        ({"grasps": {"thumb_share": 0.5}}, "grasps", AFTER_GRASPS),
        ({"grasps": {"hand": WSG50}}, "grasps", AFTER_GRASPS),
        ({"touch": {"sensor": OTHER_LIGHT}}, "touch", {"table"}),
        ({"touch": {"sensor": OTHER_RANGE}}, "grasps", AFTER_GRASPS),
        ({"surface": {"points": 2000}}, "surface", {"grasps", *AFTER_GRASPS}),
        ({"mesh": {"collision_faces": 500}}, "meshes", {"catalogue", "surface", "grasps", *AFTER_GRASPS}),
        ({"split": {"train": 1, "validation": 0, "test": 1}}, "catalogue", {"table"}),
    ],
    ids=["samples", "thumb_share", "hand", "lights", "range", "points", "faces", "split"],
)
def test_a_change_runs_again_what_depends_on_it(finished, tmp_path, config, first, others):
    if "sensor" in config.get("touch", {}):
        (tmp_path / "own.yaml").write_text(config["touch"]["sensor"])
        config = {"touch": {"sensor": str(tmp_path / "own.yaml")}}
    jobs = finished.changed(**config).jobs("dataset")
    reasons = {job.rule: job.reason for job in jobs if job.rule in STAGES}
    assert set(reasons) == {first, *others}, reasons
    assert {rule for rule, reason in reasons.items() if "by another job" not in reason} == {first}, reasons
