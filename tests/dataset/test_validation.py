"""Each check is shown to fail on a run that was damaged for it, and to pass on one that was not."""

import json
import shutil

import numpy as np
import pandas as pd
import pytest
import trimesh
import zarr

import palpate.store
from palpate import seal
from palpate.atomic import atomic_write
from palpate.dataset.checks import CHECKS, rotation_error
from palpate.dataset.run import Run
from palpate.dataset.validation import (
    check_again,
    combine_validation,
    outputs,
    read_findings,
    validate_batch,
    write_findings,
)
from palpate.mesh import OBJECT_POSITION
from palpate.sensor import DIGIT
from tests.dataset import test_forces
from tests.store.conftest import add_frames, add_presses

BATCH, OBJECT = "batch-0001", "ball-0002"  # one object, two grasps
PAIR = "batch-0000"  # two objects


def edit(stage, change, batch=BATCH):
    """A damage: `change` alters the arrays of one store in place, which is then written again."""

    def damage(run):
        path = run / palpate.store.CONTRACT[stage].path(batch)
        arrays = palpate.store.read(path)
        attributes = palpate.store.open(path).attributes
        change(arrays)
        palpate.store.write(path, stage, arrays, attributes)

    return damage


def put(stage, name, index, value):
    """A damage: some elements of one array."""

    def change(arrays):
        arrays[name][index] = value

    return edit(stage, change)


def add(stage, name, index, value):
    """A damage: something added to some elements of one array."""

    def change(arrays):
        arrays[name][index] += np.asarray(value).astype(arrays[name].dtype)

    return edit(stage, change)


def touched(name, change):
    """A damage to one array of the first successful sensor: `change(value)` in place of its value."""

    def change_first(arrays):
        index = tuple(np.argwhere(arrays["success"])[0])
        arrays[name][index] = change(arrays[name][index].copy())

    return edit("touch", change_first)


def felt_pixel(value):
    """A damage to one pixel in range; all else is kept consistent with it, so that only depth is to blame."""

    def change(depth):
        depth[tuple(np.argwhere(np.isfinite(depth))[0])] = value
        return depth

    return touched("depth", change)


def untouched(name, value):
    """A damage to one array of a sensor that touched nothing."""

    def change(arrays):
        arrays[name][tuple(np.argwhere(~arrays["success"])[0])] = value(arrays)

    return edit("touch", change)


def renewed(stage, change, *names):
    """A damage: `change(array)` in place of some arrays of a store."""
    return edit(stage, lambda arrays: arrays.update({name: change(arrays[name]) for name in names}))


def each(change):
    """A damage: `change(name, array)` in place of each array of the touch store."""
    return edit("touch", lambda arrays: arrays.update({n: change(n, a) for n, a in arrays.items()}))


def framed(damage):
    """A damage to a run that is first given frames."""

    def damage_frames(run):
        add_frames(run)
        damage(run)

    return damage_frames


def with_presses(damage):
    """A damage to a run that is first given presses."""

    def damage_presses(run):
        add_presses(run)
        damage(run)

    return damage_presses


def no_touch(arrays):
    arrays["success"][0, 1] = False
    arrays["depth"][0, 1] = np.inf
    for name in ("reading", "points", "point_count"):
        arrays[name][0, 1] = 0


def push_hand_in(run):
    """The first sensor of grasp 0 is 22 mm off the surface: move the hand on by 30 mm."""
    rows = palpate.store.read(run / f"grasps/{BATCH}.h5", "sensor_rotation")
    step = 3e-2 * rows["sensor_rotation"][0, 0, 0, :, 0]
    add("grasps", "link_pose", (0, 0, slice(None), slice(0, 3), 3), step)(run)


def move_points(arrays):
    index = tuple(np.argwhere(arrays["success"])[0])
    arrays["points"][index][0] += 2e-4 * arrays["rotation"][index][:, 0]


def file(path, change=None):
    """A damage to a file of the run; without a change it is gone, or a folder with all in it."""

    def damage(run):
        target = run / path
        if change is None:
            shutil.rmtree(target) if target.is_dir() else target.unlink()
        else:
            target.write_bytes(change(target.read_bytes()))

    return damage


def made_with(change):
    """A damage to the attributes of the vision store, which is then sealed again."""

    def damage(run):
        path = run / f"vision/{BATCH}.zarr"
        stated = change({**zarr.open_group(path).attrs, "made_from": {}})
        made_from = stated.pop("made_from")
        zarr.open_group(path, mode="r+").attrs.put(stated)
        seal.write(path, made_from)

    return damage


def change_sealed_table(run):
    table = run / "evaluations.csv"
    with atomic_write(table, seal.NOTHING) as partial:
        partial.write_text("chamfer\n1.45\n")
    table.write_text("chamfer\n1.85\n")


def flip_a_bit(data, place=100):
    return data[:place] + bytes([data[place] ^ 1]) + data[place + 1 :]


def flip_the_middle(data):
    return flip_a_bit(data, len(data) // 2)


def change_mesh(change, name="visual.glb"):
    """A damage to an object's mesh; `change` alters it in place."""

    def damage(run):
        path = run / "meshes" / BATCH / OBJECT / name
        mesh = trimesh.load_mesh(path)
        change(mesh)
        mesh.export(path)
        seal.write(run / "meshes" / BATCH)

    return damage


def scale_mesh(factor, shift=0.0, name="visual.glb"):
    return change_mesh(lambda mesh: mesh.apply_scale(factor).apply_translation([0, shift, 0]), name)


def leave_a_hole(mesh):
    mesh.update_faces(np.arange(len(mesh.faces)) > 20)


def keep_size(diagonal):
    """As if the object had kept its size, which was another one."""

    def damage(run):
        path = run / "meshes" / BATCH / OBJECT / "mesh.json"
        record = json.loads(path.read_text())
        box = [[0, 0, 0], [0, 0, diagonal / record["scale"]]]
        path.write_text(json.dumps(record | {"source": {"scale": "keep", "bounding_box": box}}))
        seal.write(run / "meshes" / BATCH)

    return damage


def retype(run):
    group = zarr.open_group(run / f"surface/{BATCH}.zarr")
    points = group["points"][:]
    group.create_array("points", data=points.astype(np.float64), overwrite=True)
    seal.write(run / f"surface/{BATCH}.zarr")


def extra_array(run):
    zarr.open_group(run / f"vision/{BATCH}.zarr").create_array("glow", data=np.zeros(3))
    seal.write(run / f"vision/{BATCH}.zarr")


def without_depth(run):
    shutil.rmtree(run / f"touch/{BATCH}.zarr/depth")
    seal.write(run / f"touch/{BATCH}.zarr")


def table(name, change):
    """A damage to the rows of a table."""

    def damage(run):
        frame = pd.read_csv(run / name)
        change(frame).to_csv(run / name, index=False)

    return damage


def again(split):
    return lambda frame: pd.concat([frame, frame[:1].assign(split=split)])


NAN, INF = np.nan, np.inf
PICTURE = ("unoccluded_mask", "unoccluded_depth")
OF_FORCES = {check for *_, check in test_forces.DAMAGES} - {"finite"}  # caught there
DAMAGES = {
    "made from": [("vision", made_with(lambda had: had | {"made_from": {"inputs": {f"grasps/{BATCH}.h5": "0" * 64}}}))],
    "readable": [
        ("surface", file(f"surface/{BATCH}.zarr")),
        ("grasps", file(f"grasps/{BATCH}.h5", lambda data: data[: len(data) // 2])),
        ("grasps", edit("grasps", lambda arrays: arrays.pop("hand/joint_range"))),
        ("touch", file(f"touch/{BATCH}.zarr/depth/c/0/0/0/0/0", flip_a_bit)),
        ("touch", file(f"touch/{BATCH}.zarr/empty_reading/c/0/0/0", flip_a_bit)),
        ("touch", file(f"touch/{BATCH}.zarr/zarr.json", lambda data: b"{")),
        ("meshes", file(f"meshes/{BATCH}/{OBJECT}/visual.glb", lambda data: data[:100])),
        ("meshes", file(f"meshes/{BATCH}/{OBJECT}")),
        ("frames", framed(renewed("frames", lambda joints: joints[..., 1:], "joint_positions", "joint_velocities"))),
    ],
    "arrays": [("surface", retype), ("vision", extra_array), ("touch", without_depth)],
    "files": [
        ("surface", file(f"surface/{BATCH}.zarr/points/c")),
        ("touch", file(f"touch/{BATCH}.zarr/success/c/0/0/0")),
        ("touch", file(f"touch/{BATCH}.zarr/success/c/0/0/0", lambda data: data[:-1])),
        ("touch", file(f"touch/{BATCH}.zarr/success/c/0/0/0", flip_the_middle)),
        ("grasps", file(f"grasps/{BATCH}.h5", flip_a_bit)),
        ("meshes", file(f"meshes/{BATCH}/{OBJECT}/visual.glb", flip_a_bit)),
        ("meshes", file(f"meshes/{BATCH}/seal.json")),
    ],
    "tables": [("run", change_sealed_table)],
    "sources": [
        ("catalogue", file(f"sources/{OBJECT}.obj")),
        ("catalogue", file(f"sources/{OBJECT}.obj", lambda data: data + b"v 0 0 0\n")),
    ],
    "attributes": [("vision", made_with(lambda had: {key: had[key] for key in had if key != "seed"}))],
    "objects": [
        ("touch", each(lambda name, array: array if name == "empty_reading" else array[:0])),
        ("vision", renewed("vision", lambda _: np.array(["ball-0001"]), "object")),
        ("surface", table("rejected.csv", lambda frame: frame.assign(stage="surface"))),
        ("surface", renewed("surface", lambda names: names[::-1], "object")),
    ],
    "rotation": [
        ("grasps", renewed("grasps", lambda pose: pose * [1, -1, 1, 1], "palm_pose")),
        ("grasps", put("grasps", "palm_pose", (0, 1, 3, 0), 1e-5)),
        ("press", with_presses(add("press", "rotation", (0, 1, 2, 0), 1e-5))),
    ],
    "scale": [("meshes", scale_mesh(1.001)), ("meshes", scale_mesh(1, shift=1e-5)), ("meshes", keep_size(0.499))],
    "collision mesh": [
        ("meshes", scale_mesh(1.016, name="collision.ply")),
        ("meshes", change_mesh(leave_a_hole, "collision.ply")),
    ],
    "inside box": [("surface", put("surface", "points", (0, 7, 2), value)) for value in (0.9, NAN)],
    "on mesh": [
        ("surface", put("surface", "points", (0, 7), [0, 0, 0.6])),
        ("touch", edit("touch", move_points)),
        ("press", with_presses(add("press", "point", (0, 1), 1e-3))),
    ],
    "joint limits": [("grasps", put("grasps", "joint_positions", (0, 1, 0), value)) for value in (0.53, NAN)],
    "kinematics": [
        ("grasps", add("grasps", "joint_positions", (0, 0, 5), 1e-3)),
        ("frames", framed(add("frames", "sensor_position", (0, 0, 1, 2), 1e-5))),
        ("grasps", add("grasps", "link_pose", (0, 0, 5, 1, 3), 1e-5)),
        ("grasps", add("grasps", "link_pose", (0, 1, 2, 3, 0), 1e-5)),
        ("grasps", add("grasps", "sensor_position", (0, 1, 2), 1e-5)),
        ("grasps", add("grasps", "sensor_rotation", (0, 1, 2, 0, 0), 1e-5)),
    ],
    "penetration": [
        ("grasps", put("grasps", "penetration", (0, 1), 0.0011)),
        ("grasps", put("grasps", "penetration", (0, 0), -1e-4)),
        ("grasps", put("grasps", "penetration", (0, 1), NAN)),
    ],
    "in hand": [("grasps", push_hand_in)],
    "sensor poses": [
        ("touch", touched("position", lambda place: place + 1e-9)),
        ("touch", add("touch", "rotation", (0, 0, 3), 1e-5)),
        ("touch", put("touch", "position", (0, 0, 0, 0), NAN)),
        ("touch", each(lambda name, rows: rows if name in ("object", "empty_reading") else rows[:, 1:])),
        ("touch", each(lambda name, rows: rows if name in ("object", "empty_reading") else rows[:, :, 1:])),
    ],
    "touch depth": [
        ("frames", framed(put("frames", "depth", (0, 0, 1, 0, 0, 0), 0.0251))),
        ("press", with_presses(put("press", "depth", (0, 1, 3, 4), 0.0251))),
        ("touch", felt_pixel(0.0)),
        ("touch", felt_pixel(-0.001)),
        ("touch", felt_pixel(0.0251)),
        ("touch", felt_pixel(NAN)),
    ],
    "success": [
        ("touch", untouched("success", lambda _: True)),
        ("frames", framed(renewed("frames", np.invert, "success"))),
    ],
    "touches": [("touch", renewed("grasps", np.invert, "touches"))],
    "one touch": [("touch", edit("touch", no_touch))],
    "point count": [("touch", touched("point_count", lambda count, step=step: count + step)) for step in (-1, 1)],
    "points": [
        ("touch", touched("points", lambda cloud: np.r_[cloud[1::-1], cloud[2:]])),
        ("touch", put("touch", "points", (0, 1, 2, 3), INF)),
        ("touch", put("touch", "points", (0, 1, 2, -1), 0.6)),
    ],
    "reading": [
        ("touch", touched("reading", lambda image: image.transpose(1, 0, 2))),
        ("touch", untouched("reading", lambda arrays: arrays["empty_reading"])),
        ("press", with_presses(renewed("press", lambda images: images[:, :, :, ::-1], "reading"))),
    ],
    "pressed": [
        ("press", with_presses(renewed("press", lambda pressure: pressure * 1.001, "pressure"))),
        ("press", with_presses(put("press", "force", (0, 1, 2), 2.1))),
        ("press", with_presses(put("press", "pressure", (0, 0, 0, 0, 0), -1e-3))),
    ],
    "press pose": [
        ("press", with_presses(add("press", "point", (0, 1, 2), 1e-4))),
        ("press", with_presses(renewed("press", lambda depth: depth - np.float32(1e-4), "depth"))),
    ],
    "outside": [("press", with_presses(put("press", "position", (0, 1), [0, 0, 0.6])))],
    "empty reading": [
        ("touch", add("touch", "empty_reading", (5, 6, 1), 1)),
        ("press", with_presses(add("press", "empty_reading", (5, 6, 1), 1))),
    ],
    "finite": [
        ("frames", framed(put("frames", "joint_velocities", (0, 1, 0, 2), NAN))),
        ("press", with_presses(put("press", "approach", (0, 1, 2), NAN))),
    ],
    "frame times": [("frames", framed(put("frames", "time", (0, 0, 1), value))) for value in (0.0, NAN)],
    "last frame": [
        ("frames", framed(add("frames", "joint_positions", (0, 1, 2, 3), 1e-12))),
        ("frames", framed(put("frames", "depth", (0, 0, 2, 0, 5, 5), 0.01))),
    ],
    "image frames": [("frame_images", framed(put("frame_images", "image_frame", (0, 0, 1), 1)))],
    "mask values": [("vision", put("vision", "occluded_mask", (0, 1, 0, 30, 30), 254))],
    "camera": [
        ("vision", put("vision", "intrinsics", (0, 0, 1, 1), 100.0)),
        ("vision", put("vision", "intrinsics", (0, 0, 0, 0), NAN)),
        ("vision", add("vision", "extrinsics", (0, 0, 0, 0), 1e-5)),
        ("vision", put("vision", "extrinsics", (0, 0, 2, 3), NAN)),
    ],
    "image depth": [
        ("vision", put("vision", "occluded_depth", (0, 0, 0, 0, 0), NAN)),
        ("vision", put("vision", "occluded_depth", (0, 1, 0, 5, 5), 3.0)),
        ("vision", put("vision", "unoccluded_depth", (0, 0, 0, 0), 1.0)),
    ],
    "seen": [("vision", put("vision", "occluded", (0, 1), 128)), ("vision", put("vision", "unoccluded_mask", ..., 0))],
    "picture of mesh": [
        ("vision", renewed("vision", lambda array: np.roll(array, 2, axis=3), *PICTURE)),
        ("vision", renewed("vision", lambda array: array[..., ::-1], *PICTURE)),
        ("vision", add("vision", "unoccluded_depth", (0,), 2e-3)),
        ("vision", add("vision", "intrinsics", (0, 0, [0, 1], [0, 1]), 4.0)),
        ("vision", add("vision", "extrinsics", (0, 0, 2, 3), 0.03)),
    ],
    "occlusion": [
        ("vision", put("vision", "occluded_mask", (0, 0), 0)),
        ("vision", put("vision", "occluded_mask", (0, 1), 255)),
        ("vision", add("vision", "occluded_depth", (0, 1), 3e-3)),
    ],
    "one split": [
        ("catalogue", table("catalogue.csv", again("train"))),
        ("catalogue", table("catalogue.csv", again("test"))),
        ("catalogue", table("catalogue.csv", lambda frame: frame.assign(split="dev"))),
    ],
}


def validate(run, *others) -> pd.DataFrame:
    """The report on BATCH, and on the batches of other tables."""
    table = run / f"reports/validation/{BATCH}.csv"
    write_findings(table, validate_batch(run, BATCH))
    findings = [finding for path in (table, *others) for finding in read_findings(path)]
    return combine_validation(findings, run, run / "sources", outputs(run))


@pytest.fixture(scope="module")
def pair(built, tmp_path_factory):
    """Table of the findings on the undamaged batch of two objects."""
    table = tmp_path_factory.mktemp("findings") / f"{PAIR}.csv"
    write_findings(table, validate_batch(built, PAIR))
    return table


def test_a_good_run_passes_every_check(run, pair):
    add_frames(run)
    add_presses(run)
    report = validate(run, pair)
    assert report.passed.all(), report[~report.passed].to_string()
    assert set(report.check) == set(CHECKS) - OF_FORCES
    assert list(report.columns) == ["check", "store", "batch", "objects", "worst", "limit", "passed", "where"]
    clouds = report[(report.check == "on mesh") & (report.store == "touch")].set_index("batch")
    assert clouds.objects.to_dict() == {BATCH: 1, PAIR: 2}
    assert (report["where"] == "").all()


def test_a_batch_is_validated_before_there_is_a_catalogue_of_all(run):
    stages = Run(run).asked_stores
    found = validate_batch(run, PAIR, stages=stages, others=False)
    assert found and all(finding.ok for finding in found)
    (run / "catalogue.csv").unlink()
    assert validate_batch(run, PAIR, stages=stages, others=False) == found


def test_each_array_is_read_once(run, monkeypatch):
    """Of arrays of objects each row is read, one at a time, of others all."""
    add_frames(run)
    reads, gets = [], palpate.store.Store.get

    def getting(store, name, index=...):
        reads.append((store.path, name, index))
        return gets(store, name, index)

    monkeypatch.setattr(palpate.store.Store, "get", getting)
    monkeypatch.setattr(palpate.store.Store, "__getitem__", getting)
    assert all(finding.ok for finding in validate_batch(run, PAIR))
    rows = {}
    for path, name, index in reads:
        rows.setdefault((path, name), []).append(index)
    assert all(indices in ([0, 1], [...], [..., 0, 1]) for indices in rows.values()), rows
    paths = {path for path, _ in rows}
    assert {path.parent.name for path in paths} >= {"surface", "grasps", "touch", "frames", "vision"}
    for path in paths:
        needed = (each for each in palpate.store.CONTRACT[path.parent.name].arrays.values() if not each.optional)
        assert {each.name for each in needed if each.of_objects} <= {name for at, name in rows if at == path}


def test_asking_again_compares_every_file_and_looks_at_values_again_where_files_are_others(run):
    tables = [run / f"reports/validation/{batch}.csv" for batch in (PAIR, BATCH)]
    for table in tables:
        write_findings(table, validate_batch(run, table.stem))
    before = [finding for table in tables for finding in read_findings(table)]
    again, anew = check_again(run, tables)
    assert anew == 0 and sorted(again) == sorted(before)
    store = run / f"touch/{BATCH}.zarr"
    kept = shutil.copytree(store, run / "kept.zarr")
    # A store that was built again, with wrong values: the table is older than it, whatever the times of the files.
    put("touch", "points", (0, 1, 2, 3), np.inf)(run)
    again, anew = check_again(run, tables)
    assert anew == 1 and {finding.check for finding in again if not finding.ok} >= {"points"}
    # A file of it is damaged: its values are not worth a look.
    shutil.rmtree(store)
    kept.rename(store)
    (store / "depth/c/0/0/0/0/0").unlink()
    again, anew = check_again(run, tables)
    failed = [finding for finding in again if not finding.ok]
    assert anew == 0 and [(finding.check, finding.store) for finding in failed] == [("files", "touch")]
    assert "depth/c/0/0/0/0/0 is missing" in failed[0].where


def test_every_check_has_a_damage_that_it_catches():
    assert set(DAMAGES) | OF_FORCES == set(CHECKS)


CASES = [
    pytest.param(check, store, damage, id=f"{check}-{store}-{number}")
    for check, damages in DAMAGES.items()
    for number, (store, damage) in enumerate(damages)
]


@pytest.mark.parametrize("check, store, damage", CASES)
def test_damage_is_caught_and_named(run, pair, check, store, damage):
    damage(run)
    report = validate(run, pair)
    failed = report[~report.passed]
    caught = failed[(failed.check == check) & (failed.store == store)]
    assert len(caught) == 1, failed.to_string()
    row = caught.iloc[0]
    assert not row.worst <= row.limit
    assert check in ("sensor poses", "empty reading") or row["where"]


def test_failures_name_object_grasp_and_sensor(run):
    put("touch", "points", (0, 1, 2, 3), np.inf)(run)
    failed = [finding for finding in validate_batch(run, BATCH) if not finding.ok]
    points = next(finding for finding in failed if finding.check == "points")
    assert (points.store, points.batch, points.object) == ("touch", BATCH, OBJECT)
    assert points.where == "grasp 1, sensor ring"


def test_sensors_have_the_names_of_the_runs_own_hand(run):
    put("grasps", "hand/sensor_names", slice(None), ["left", "right", "high", "low"])(run)
    put("touch", "points", (0, 1, 2, 3), np.inf)(run)
    failed = [finding for finding in validate_batch(run, BATCH) if not finding.ok]
    assert {finding.where for finding in failed if finding.check == "points"} == {"grasp 1, sensor high"}


def test_stores_made_with_another_hand_are_named_and_the_rest_is_checked(run):
    """Frames of a hand of fewer joints, touches of one of more sensors, the last of which reads something else."""
    add_frames(run)
    renewed("frames", lambda joints: joints[..., 1:], "joint_positions", "joint_velocities")(run)
    names = set(palpate.store.read(run / f"touch/{BATCH}.zarr")) - {"object", "empty_reading"}
    renewed("touch", lambda rows: np.concatenate([rows, rows[:, :, :1]], axis=2), *names)(run)
    add("touch", "reading", (0, 0, 4), 5)(run)
    findings = validate_batch(run, BATCH)
    failed = {(each.check, each.store): each for each in findings if not each.ok}
    assert {*failed} == {("readable", "frames"), ("sensor poses", "touch"), ("reading", "touch")}
    assert {each.object for each in failed.values()} == {OBJECT}
    assert failed["reading", "touch"].where == "grasp 0, sensor 4"
    touches, frames = failed["sensor poses", "touch"].where, failed["readable", "frames"].where
    assert f"touch/{BATCH}.zarr does not fit grasps: ValueError: grasps and sensors of an object are (2, 5)" in touches
    assert f"frames/{BATCH}.zarr does not fit" in frames and "grasps" in frames and "joint positions" in frames
    assert "build them again from one config" in touches and "build them again from one config" in frames
    assert {"vision", "surface"} <= {each.store for each in findings if each.object}


def test_only_the_stages_asked_for_are_needed(run):
    shutil.rmtree(run / "vision")
    shutil.rmtree(run / "touch")
    findings = validate_batch(run, PAIR, stages=("surface", "grasps"))
    assert all(finding.ok for finding in findings)
    assert {finding.store for finding in findings} == {"meshes", "surface", "grasps"}


@pytest.mark.parametrize("see_through", [True, False])
@pytest.mark.parametrize(("shift", "fits"), [(np.inf, True), (0.02, True), (-0.02, False)])
def test_a_transparent_mesh_may_show_what_is_behind_it_only(run, see_through, shift, fits):
    """Some of the object's pixels show nothing, or something further off or nearer than its first face."""
    path = run / "meshes" / BATCH / OBJECT / "mesh.json"
    path.write_text(json.dumps(json.loads(path.read_text()) | {"visual.glb": {"see_through": see_through}}))
    seal.write(run / "meshes" / BATCH)
    window = (..., slice(26, 38), slice(22, 30))  # on the object, left of what hides it

    def change(arrays):
        for name in ("unoccluded", "occluded"):
            assert (arrays[f"{name}_mask"][window] == 255).all()
            arrays[f"{name}_depth"][window] += np.float16(shift)
            arrays[f"{name}_mask"][window] = 0 if shift == np.inf else 255

    edit("vision", change)(run)
    failed = {finding.check for finding in validate_batch(run, BATCH) if not finding.ok}
    assert failed == (set() if fits and see_through else {"picture of mesh"})


def test_the_limit_of_penetration_is_the_runs(run):
    put("grasps", "penetration", (0, 0), 0.001)(run)  # stored as float32, a little over 0.001
    assert all(finding.ok for finding in validate_batch(run, BATCH))
    strict = validate_batch(run, BATCH, max_penetration=5e-4)
    assert [finding.check for finding in strict if not finding.ok] == ["penetration"]


def test_a_batch_whose_objects_were_all_rejected_is_valid(run):
    shutil.rmtree(run / "touch" / f"{BATCH}.zarr")
    rejections = [f"{name},meshes,no area" for name in ("ball-0001", OBJECT)]
    (run / "rejected.csv").write_text("\n".join(["object,stage,reason", *rejections, ""]))
    for stage in ("surface", "grasps", "touch", "vision"):
        arrays = palpate.store.join(stage, {})
        if stage == "touch":
            arrays["empty_reading"] = palpate.store.read(run / f"touch/{PAIR}.zarr")["empty_reading"]
        if stage == "grasps":
            stored = palpate.store.read(run / f"grasps/{PAIR}.h5")
            arrays |= {name: array for name, array in stored.items() if name.startswith("hand/")}
        path = run / palpate.store.CONTRACT[stage].path(BATCH)
        palpate.store.write(path, stage, arrays, {"made_from": {}, "seed": 0, "sensor": DIGIT.description()})
    findings = validate_batch(run, BATCH)
    assert all(finding.ok for finding in findings), [finding for finding in findings if not finding.ok]


def test_rotation_error_of_known_matrices():
    quarter = np.array([[0.0, -1, 0], [1, 0, 0], [0, 0, 1]])
    mirror = np.diag([1.0, 1, -1])
    stretched = np.diag([1.0, 1, 1.1])
    errors = rotation_error(np.stack([quarter, mirror, stretched]))
    np.testing.assert_allclose(errors, [0, 2, 0.21], atol=1e-12)


def test_an_object_that_kept_its_size_passes_and_may_be_larger_than_the_others(run):
    """Its mesh, its points and its record are twice as large; only what saw or touched it as it was fails."""
    for name in ("visual.glb", "collision.ply"):
        scale_mesh(2, name=name)(run)
    keep_size(1.0)(run)

    def double(arrays):
        row = arrays["object"].tolist().index(OBJECT)
        arrays["points"][row] = 2 * (arrays["points"][row] - OBJECT_POSITION) + OBJECT_POSITION

    edit("surface", double)(run)
    found = [finding for finding in validate_batch(run, BATCH) if finding.object == OBJECT]
    found = [finding for finding in found if finding.store in ("meshes", "surface")]
    assert {"scale", "inside box", "on mesh"} <= {finding.check for finding in found}
    assert all(finding.ok for finding in found), [finding for finding in found if not finding.ok]
