"""A change of the config runs again what depends on it, and nothing else."""

import pytest

STAGES = {"catalogue_batch", "catalogue", "meshes", "surface", "grasps", "touch", "vision", "table"}
AFTER_GRASPS = {"touch", "vision", "table"}


@pytest.mark.parametrize(
    ("config", "first", "others"),
    [
        ({"vision": {"size": 64, "samples": 3, "device": "cpu"}}, "vision", set()),
        ({"touch": {"method": "sphere_tracing"}}, "touch", {"table"}),
        ({"grasps": {"thumb_share": 0.5}}, "grasps", AFTER_GRASPS),
        ({"grasps": {"hand": {}}}, "grasps", AFTER_GRASPS),
        ({"surface": {"points": 2000}}, "surface", {"grasps", *AFTER_GRASPS}),
        ({"mesh": {"levels": [500]}}, "meshes", {"surface", "grasps", *AFTER_GRASPS}),
        ({"split": {"test": 1000}}, "catalogue_batch", {"catalogue", "table"}),
    ],
    ids=["samples", "method", "thumb_share", "hand", "points", "levels", "split"],
)
def test_a_change_runs_again_what_depends_on_it(finished, tmp_path, config, first, others):
    if config == {"grasps": {"hand": {}}}:
        for name in ("mjcf", "sensors"):
            (tmp_path / name).write_text("<mujoco/>")
            config["grasps"]["hand"][name] = str(tmp_path / name)
    jobs = finished.changed(**config).jobs("dataset")
    reasons = {job.rule: job.reason for job in jobs if job.rule in STAGES}
    assert set(reasons) == {first, *others}, reasons
    assert {rule for rule, reason in reasons.items() if "by another job" not in reason} == {first}, reasons
