"""What stages get that close the hand again."""

from types import SimpleNamespace

import numpy as np

from palpate.sensor import DIGIT
from workflow.run import kept_grasps


def test_the_arrays_of_the_hand_are_not_an_objects_also_if_they_are_as_many(monkeypatch):
    """A batch of four objects, and a hand with four sensors."""
    names = np.array(list("abcd"))
    grasps = {
        "object": names,
        "attempts": np.arange(4),
        "touches": np.ones((4, 2, 4)),
        "hand/sensor_link": np.arange(4),
    }
    surface = {"object": names, "points": np.zeros((4, 9, 3))}
    monkeypatch.setattr(kept_grasps.store, "read", lambda _: grasps)
    monkeypatch.setattr(kept_grasps.store, "open", lambda _: surface)
    monkeypatch.setattr(kept_grasps.Hand, "from_arrays", lambda *_, prefix: prefix)
    for load in ("load_visual", "load_collision"):
        monkeypatch.setattr(kept_grasps.mesh, load, lambda folder: folder.name)
    monkeypatch.setattr(kept_grasps.grasp, "grasper_type", lambda *_: lambda visual, *_, **settings: (visual, settings))
    inputs = SimpleNamespace(meshes="meshes", grasps="grasps", surface="surface")
    settings = {"timestep": 0.002, "max_penetration": 0.002, "thumb_share": 0.5}
    params = SimpleNamespace(grasps=settings | {"attempts": 9}, hold={})
    found = list(kept_grasps.each_kept(inputs, params, DIGIT))
    assert [name for name, _, _ in found] == [*"abcd"]
    assert found[2][1] == ("c", settings | {"sensor": DIGIT})
    assert found[2][2].keys() == {"object", "attempts", "touches"} and found[2][2]["attempts"] == 2
