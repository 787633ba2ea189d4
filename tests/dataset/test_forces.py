"""Contacts of frames, and labels of holding, as the reader, the checks and the table give them."""

import shutil

import numpy as np
import pytest

import palpate
from palpate.dataset.validation import validate_batch
from palpate.grasp.contacts import OBJECT, Contacts, contact_arrays
from palpate.hand import allegro
from palpate.results.dataset_tables import TOTAL, hold
from tests.store.conftest import ATTRIBUTES, BATCHES, add_frames

HAND = allegro()
STAGES = ("surface", "grasps", "touch", "frames", "hold")


@pytest.fixture(scope="module")
def forced(built, tmp_path_factory):
    """The run with frames that have random contacts, and labels of random distances; to be read only."""
    run = shutil.copytree(built, tmp_path_factory.mktemp("forced") / "run")
    add_frames(run)
    draw = np.random.default_rng(0)
    for batch in BATCHES:
        path = run / f"frames/{batch}.zarr"
        arrays = palpate.store.read(path)
        names, shape = arrays["object"], arrays["time"].shape
        found = [[contacts_of(arrays, (row, grasp), draw) for grasp in range(shape[1])] for row in range(len(names))]
        for name in found[0][0]:
            dtype = palpate.store.CONTRACT["frames"].arrays[name].dtype
            arrays[name] = np.array([[each[name] for each in of_object] for of_object in found], dtype)
        palpate.store.write(path, "frames", arrays, ATTRIBUTES)
        moved = draw.uniform(0, 0.03, (*shape[:2], 6))
        moved[0, 0] = draw.uniform(0, 0.02, 6)
        moved[-1, -1, 2] = np.inf
        along = np.where(moved < np.inf, moved <= 0.02, -1)
        held = np.where((along < 0).any(axis=2), -1, (along == 1).all(axis=2))
        of_object = {"mass": np.full(len(names), 0.5), "solid": np.ones(len(names), bool)}
        quality = {"wrench_radius": np.where(held == 1, 0.5, 0.0), "cone_margin": np.where(held == 1, 0.25, 0.0)}
        rows = {"held": held, "held_along": along, "moved": moved} | quality | of_object
        records = {name: {key: values[row] for key, values in rows.items()} for row, name in enumerate(names)}
        palpate.store.write(run / f"hold/{batch}.zarr", "hold", palpate.store.join("hold", records), ATTRIBUTES)
    return run


def contacts_of(arrays, index, draw):
    """Of the frames of one grasp: none, then some on the sensors' links and elsewhere."""
    frames = []
    for count in (0, 3, 9):
        normal = draw.normal(size=(count, 3))
        normal /= np.linalg.norm(normal, axis=1, keepdims=True)
        place = arrays["sensor_position"][index][0, 0] + draw.normal(scale=0.01, size=(count, 3))
        link = draw.choice([*HAND.sensor_link, 2], count)
        force = -np.sort(-draw.uniform(0, 2, count))
        other = np.where(draw.random(count) < 0.8, OBJECT, 1)
        frames.append(Contacts(place, normal, force, link, other, np.zeros((count, 3))))
    poses = (arrays[name][index] for name in ("sensor_position", "sensor_rotation"))
    return contact_arrays(frames, HAND.sensor_link, *poses)


def failed(run, batch="batch-0000"):
    return {finding.check for finding in validate_batch(run, batch, stages=STAGES) if not finding.ok} - {"made from"}


def test_a_grasp_has_its_contacts_and_its_label(forced):
    for record in palpate.Dataset(forced):
        assert record.mass == 0.5 and record.solid
        for grasp in record.grasps:
            frames = grasp.frames
            assert frames.contact_count.tolist() == [0, 3, 9] and frames.sensor_wrench.shape == (3, 4, 6)
            taken = frames.contact_link[-1] == HAND.sensor_link[0]
            taken &= (frames.contact_other[-1] == OBJECT) & (np.arange(32) < 9)
            push = frames.contact_force[-1][taken] @ frames.contact_normal[-1][taken]
            np.testing.assert_allclose(
                frames.sensor_rotation[-1, 0] @ frames.sensor_wrench[-1, 0, :3], push, atol=1e-12
            )
            if grasp.held >= 0:
                assert grasp.held == (grasp.moved <= 0.02).all()
    items = palpate.Dataset(forced).grasps()
    assert {"held", "moved", "frames_contact_force", "frames_sensor_wrench"} <= set(items[0])


DAMAGES = [
    ("frames", "contact_force", lambda values: -values, "contacts"),
    ("frames", "contact_normal", lambda values: 1.001 * values, "contacts"),
    ("frames", "contact_count", lambda values: values - (values > 0), "contacts"),
    ("frames", "sensor_wrench", lambda values: values + 1e-5, "wrench"),
    ("frames", "contact_position", lambda values: values * np.nan, "finite"),
    ("hold", "held", lambda values: 1 - values, "held"),
    ("hold", "held_along", lambda values: np.where(values == 1, 0, values), "held"),
    ("hold", "moved", lambda values: np.where(values < np.inf, values, np.nan), "finite"),
]


def test_right_forces_and_labels_pass(forced):
    assert not failed(forced) and not failed(forced, "batch-0001")


@pytest.mark.parametrize(("stage", "name", "change", "check"), DAMAGES)
def test_wrong_forces_and_labels_are_found(forced, tmp_path, stage, name, change, check):
    damaged = shutil.copytree(forced, tmp_path / "run")
    for batch in BATCHES:
        path = damaged / f"{stage}/{batch}.zarr"
        arrays = palpate.store.read(path)
        arrays[name] = change(arrays[name]).astype(arrays[name].dtype)
        palpate.store.write(path, stage, arrays, ATTRIBUTES)
    assert check in failed(damaged) | failed(damaged, "batch-0001")


def test_shares_are_counted(forced):
    dataset = palpate.Dataset(forced, STAGES)
    table = hold(dataset).set_index(["class", "touches"])
    grasps = [(record.class_name, grasp) for record in dataset for grasp in record.grasps]
    assert table.loc[(TOTAL, "any"), "not_simulated"] == sum(grasp.held < 0 for _, grasp in grasps) > 0
    for (name, touches), row in table.iterrows():
        mine = [
            grasp for each, grasp in grasps
            if name in (each, TOTAL) and touches in (str(grasp.success.sum()), "any") and grasp.held >= 0
        ]  # fmt: skip
        assert row["grasps"] == len(mine)
        if mine:
            shares = [
                (grasp.held == 1, (grasp.held_along == 1).any(), (grasp.held_along == 1).mean()) for grasp in mine
            ]
            expected = 100 * np.mean(shares, axis=0)
            found = row[["all_percent", "some_percent", "directions_percent"]].to_numpy(float)
            np.testing.assert_allclose(found, expected, atol=0.01)
