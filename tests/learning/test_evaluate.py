"""Small models that were never trained, on a run of spheres: what is measured of them is known otherwise."""

import json
from unittest import mock

import numpy as np
import pandas as pd
import pytest
import torch
import trimesh

from palpate import Dataset, store
from palpate.architectures import Architecture
from palpate.batch import generator
from palpate.camera import paper_camera
from palpate.charts import build_tree, sample_faces, touch_chart, vision_atlas
from palpate.experiments import Correction, Experiment
from palpate.learning import evaluate as evaluation
from palpate.learning.data import ExperimentData
from palpate.learning.evaluate import Trained, evaluate, evaluate_rings, evaluate_touch, training_steps
from palpate.learning.metrics import score, seeded
from palpate.learning.rings import MeshSurface, project_batch, ring_points
from palpate.learning.rows import (
    COLUMNS,
    RING_COLUMNS,
    SELECTION_COLUMNS,
    TOUCH_COLUMNS,
    EvaluationError,
    read,
)
from palpate.learning.selection import evaluate_selection
from palpate.mesh import OBJECT_POSITION
from palpate.models import SINGLE_IMAGE_MODELS, Reconstruction, TouchDepth
from palpate.sensor import DIGIT
from palpate.touch import RayCaster, empty_reading, sense
from palpate.vision import views
from tests.models.batches import SMALL, templates

SPLITS = {"ball-0000": "train", "ball-0001": "validation", "ball-0002": "test", "ball-0003": "test"}
RADII = dict(zip(SPLITS, (0.05, 0.06, 0.07, 0.08), strict=True))
GRASPS = 2
ATTRIBUTES = {"seed": 0, "made_from": {}, "sensor": DIGIT.description()}
OCCLUDED_TOUCH = Experiment("model", "charts", "occluded", True, 1)
UNOCCLUDED = Experiment("model", "charts", "unoccluded", False, 1)
MODEL_SEED = 7
CAMERAS = np.tile(paper_camera().matrix().astype(np.float32), (len(SPLITS), 1, 1, 1))  # of images, (o, 1, 3, 4)


def ball(name: str) -> trimesh.Trimesh:
    return trimesh.creation.icosphere(subdivisions=3, radius=RADII[name])


def poses(name: str) -> tuple[np.ndarray, np.ndarray]:
    """Sensors (g, 4) around a sphere that look at it; the last of each grasp is too far off."""
    rng = np.random.default_rng(len(name) + int(1000 * RADII[name]))
    forward = rng.normal(size=(GRASPS, 4, 3))
    forward /= np.linalg.norm(forward, axis=2, keepdims=True)
    gap = np.array([0.02, 0.019, 0.021, 0.06])[None, :, None]
    position = np.array(OBJECT_POSITION) - forward * (RADII[name] + gap)
    up = np.cross(forward, forward[..., ::-1] + [0.1, 0, 0])
    up /= np.linalg.norm(up, axis=2, keepdims=True)
    return position, np.stack([forward, up, np.cross(forward, up)], axis=3)


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    folder = tmp_path_factory.mktemp("evaluation")
    rows = [f"{name},ball,{split},batch-0000" for name, split in SPLITS.items()]
    (folder / "catalogue.csv").write_text("object,class,split,batch\n" + "\n".join(rows) + "\n")
    (folder / "rejected.csv").write_text("object,stage,reason\n")
    touch = {}
    for name in SPLITS:
        position, rotation = poses(name)
        tracer = RayCaster(ball(name), OBJECT_POSITION)
        felt = [sense(tracer, *pose) for pose in zip(position, rotation, strict=True)]
        touch[name] = {key: np.stack([getattr(each, key) for each in felt]) for key in felt[0]._fields}
        touch[name] |= {"position": position, "rotation": rotation}
    path = folder / "touch" / "batch-0000.zarr"
    arrays = store.join("touch", touch) | {"empty_reading": empty_reading()}
    store.write(path, "touch", arrays, ATTRIBUTES)
    rings = project_batch(path, lambda name, _: MeshSurface(ball(name), OBJECT_POSITION))
    store.write(folder / "rings" / "batch-0000.zarr", "rings", rings, ATTRIBUTES)
    # Each chart is the sensor's own square: its points are on the sensor plane.
    grid = np.concatenate([np.zeros((81, 1)), touch_chart().grid.numpy()], axis=1)
    charts = arrays["position"][..., None, :] + np.einsum("vi,ogsji->ogsvj", grid, arrays["rotation"])
    held = {"object": arrays["object"], "vertices": charts.astype(np.float32)}
    store.write(folder / "charts" / "batch-0000.zarr", "charts", held, ATTRIBUTES)
    return folder


@pytest.fixture(scope="module")
def data(run) -> ExperimentData:
    """What both experiments take of the run, in memory."""
    touch = store.read(run / "touch" / "batch-0000.zarr")
    charts = store.read(run / "charts" / "batch-0000.zarr")["vertices"]
    rng = np.random.default_rng(0)
    points = np.stack([trimesh.sample.sample_surface(ball(name), 2000, seed=1)[0] for name in SPLITS])
    of_grasps = {
        "success": touch["success"],
        "position": touch["position"].astype(np.float32),
        "rotation": touch["rotation"].astype(np.float32),
        "charts": charts,
    }
    arrays = of_grasps | {
        "object": np.array(list(SPLITS)),
        "class": np.array(["ball"] * len(SPLITS)),
        "split": np.array(list(SPLITS.values())),
        "points": (points + OBJECT_POSITION).astype(np.float32),
        "occluded": rng.integers(0, 256, (len(SPLITS), GRASPS, 1, 256, 256, 3), dtype=np.uint8),
        "image_camera": CAMERAS,
    }
    return ExperimentData(arrays)


@pytest.fixture(scope="module")
def unoccluded_data(data) -> ExperimentData:
    arrays = {name: np.array(getattr(data, attribute)) for name, attribute in
              (("object", "objects"), ("class", "classes"), ("split", "splits"))}  # fmt: skip
    arrays |= {"points": data["points"], "unoccluded": data["occluded"][:, 0], "image_camera": CAMERAS}
    return ExperimentData(arrays)


def untrained(experiment, templates=None) -> Trained:
    torch.manual_seed(MODEL_SEED)
    model = Reconstruction(experiment, Architecture.from_row(SMALL), templates=templates).eval()
    return Trained(model, experiment, 3, 700)


def test_every_sample_is_scored_against_its_own_object(data):
    """The mesh as the model itself gives it, one sample at a time, and the naive score of its points."""
    trained = untrained(OCCLUDED_TOUCH)
    table = evaluate(trained, data, points=300)
    assert list(table.columns) == list(COLUMNS)
    assert len(table) == 3 * GRASPS and set(table["split"]) == {"validation", "test"}
    assert (table[["experiment", "seed", "steps", "class"]] == ["model", 3, 700, "ball"]).all(axis=None)
    assert (table["seconds"] > 0).all()
    for row in table.to_dict("records"):
        number, grasp = data.objects.index(row["object"]), row["window"]
        of_touch = {key: torch.from_numpy(data[key][number, grasp])[None] for key in
                    ("success", "position", "rotation", "charts")}  # fmt: skip
        image = torch.from_numpy(data["occluded"][number, grasp, 0]).permute(2, 0, 1)[None].float() / 255
        with torch.inference_mode():
            vertices = trained.model(of_touch | {"image": image, "camera": torch.from_numpy(CAMERAS[0])})
        points = sample_faces(vertices, trained.model.faces, 300, seeded(0, row["object"], "evaluation"))[0]
        pairs = torch.cdist(points.double(), torch.from_numpy(data["points"][number]).double()) ** 2
        naive = 9000 * (pairs.amin(dim=0).mean() + pairs.amin(dim=1).mean())
        assert row["chamfer"] == pytest.approx(float(naive), rel=1e-3)
        mesh = trimesh.Trimesh(vertices[0].numpy(), vision_atlas().faces.numpy(), process=False)
        assert row["bend"] == pytest.approx(np.degrees(mesh.face_adjacency_angles).mean(), rel=1e-3)


@pytest.mark.parametrize("strategy", SINGLE_IMAGE_MODELS)
def test_the_published_single_image_networks_are_measured_by_the_same_protocol(data, strategy):
    """By all pairs: Pixel2Mesh on 300 points of its faces, 3D-R2N2 on its cells' surface, PSG's points as they are."""
    rng = np.random.default_rng(1)
    arrays = {"object": np.array(data.objects), "class": np.array(data.classes), "split": np.array(data.splits)}
    arrays |= {"points": data["points"], "views": data["occluded"][:, :, 0, :137, :137, :]}
    at = views.viewpoints(rng, len(SPLITS) * GRASPS)
    cameras = np.stack([views.camera(viewpoint).matrix() for viewpoint in at]).astype(np.float32)
    arrays["camera"] = cameras.reshape(len(SPLITS), GRASPS, 3, 4)
    torch.manual_seed(MODEL_SEED)
    decoder = {"hidden": 8, "points": 50, "channels": [4, 4, 4, 4], "level": 0.5}
    architecture = SMALL | {"encoder": SMALL["encoder"] | {"padding": 1}, "decoder": decoder}
    model = SINGLE_IMAGE_MODELS[strategy](Architecture.from_row(architecture)).eval()
    experiment = Experiment("model", strategy, "views", False, 1)
    table = evaluate(Trained(model, experiment, 3, 700), ExperimentData(arrays), points=300)
    assert table["object"].tolist() == [name for name in list(SPLITS)[1:] for _ in range(GRASPS)]
    for row in table.to_dict("records"):
        number, view = data.objects.index(row["object"]), row["window"]
        image = torch.from_numpy(arrays["views"][number, view]).permute(2, 0, 1)[None].float() / 255
        with torch.inference_mode():
            found = model({"image": image, "camera": torch.from_numpy(arrays["camera"][number, view])[None]})
        if strategy == "psg":
            points = found[0]
        else:
            vertices, faces = model.mesh(found[0])
            points = sample_faces(vertices[None], faces, 300, seeded(0, row["object"], "evaluation"))[0]
        pairs = torch.cdist(points.double(), torch.from_numpy(data["points"][number]).double()) ** 2
        there, back = pairs.amin(dim=1), pairs.amin(dim=0)
        assert row["chamfer"] == pytest.approx(float(9000 * (there.mean() + back.mean())), rel=1e-3)
        for column, threshold in (("f1_tau", 1e-4), ("f1_2tau", 2e-4)):
            near = [float((side * (0.57 / 0.5) ** 2 < threshold).double().mean()) for side in (there, back)]
            assert row[column] == pytest.approx(200 * near[0] * near[1] / max(sum(near), 1e-9), abs=0.2)


def test_it_does_not_depend_on_how_many_are_predicted_together(data, monkeypatch):
    trained = untrained(OCCLUDED_TOUCH)
    together = evaluate(trained, data, points=300)
    monkeypatch.setattr(evaluation, "BATCH_SIZE", 1)
    alone = evaluate(trained, data, points=300)
    scores = ["chamfer", "f1_tau", "f1_2tau"]
    np.testing.assert_allclose(alone[scores], together[scores], rtol=1e-3, atol=0.3)


def test_a_model_that_takes_no_grasp_has_one_sample_an_object(unoccluded_data):
    table = evaluate(untrained(UNOCCLUDED), unoccluded_data, points=300)
    assert table["object"].tolist() == list(SPLITS)[1:] and (table["window"] == 0).all()


def test_rings_are_those_of_the_samples_own_touches(run, data):
    trained = untrained(OCCLUDED_TOUCH)
    table = evaluate_rings(trained, data, Dataset(run), ["test"], points=500)
    assert list(table.columns) == list(RING_COLUMNS) and set(table["object"]) == {"ball-0002", "ball-0003"}
    # Three of four sensors touch, in every grasp; each has five rings.
    assert len(table) == 2 * GRASPS * 3 * 5 and (table["window"] == table["grasp"]).all()
    row = table[(table["object"] == "ball-0003") & (table["grasp"] == 1) & (table["sensor"] == 2)].iloc[2]
    position, rotation = (array[1, 2] for array in poses("ball-0003"))
    depth = MeshSurface(ball("ball-0003"), OBJECT_POSITION).project(position, rotation)
    points = ring_points(depth, position, rotation)[2]
    assert row["ring"] == 3 and row["points"] == len(points)
    predictions = {
        (data.objects[sample.object], sample.window): vertices
        for sample, (vertices, _), _ in evaluation.predictions(trained, data, ["test"])
    }
    draw = seeded(0, "ball-0003", "evaluation")
    predicted = sample_faces(predictions["ball-0003", 1][None], trained.model.faces, 500, draw)[0].numpy()
    pairs = ((points[:, None] - predicted[None]) ** 2).sum(axis=2)
    assert row["distance"] == pytest.approx(pairs.min(axis=1).mean(), rel=1e-4)


def test_without_touch_rings_are_around_all_touches_of_the_object(run, unoccluded_data):
    table = evaluate_rings(untrained(UNOCCLUDED), unoccluded_data, Dataset(run), ["test"], points=500)
    assert len(table) == 2 * GRASPS * 3 * 5 and (table["window"] == 0).all()
    assert set(table["grasp"]) == {0, 1}


def test_touch_charts_and_clouds_are_scored_where_they_are(run):
    torch.manual_seed(0)
    model = TouchDepth(width=4).eval()
    table = evaluate_touch(model, 30, Dataset(run, ["touch", "charts"]), points=1000)
    assert list(table.columns) == list(TOUCH_COLUMNS)
    assert len(table) == 3 * GRASPS * 3 and (table["steps"] == 30).all()
    assert sorted(set(table["object"])) == sorted(SPLITS)[1:] and set(table["sensor"]) == {0, 1, 2}
    touch = store.read(run / "touch" / "batch-0000.zarr")
    row = table[(table["object"] == "ball-0002") & (table["grasp"] == 1) & (table["sensor"] == 1)].iloc[0]
    index = (list(SPLITS).index("ball-0002"), 1, 1)
    true = touch["points"][index][: touch["point_count"][index]].astype(float)
    # The cloud, put into the world by hand: pixels that differ from the empty gel, at the predicted depth.
    reading = torch.from_numpy(touch["reading"][index]).permute(2, 0, 1)[None].float() / 255
    with torch.inference_mode():
        depth = model(reading)[0].numpy()
    change = ((touch["reading"][index] / 255.0 - touch["empty_reading"] / 255.0) ** 2).sum(axis=2)
    rows, columns = np.nonzero(change > 0.001)
    side = ((np.arange(100) + 0.5) / 100 - 0.5) * 0.01641
    local = np.stack([depth[rows, columns], side[columns], side[rows]], axis=1)
    cloud = local @ touch["rotation"][index].T + touch["position"][index]
    found = score(torch.from_numpy(cloud), build_tree(torch.from_numpy(true)))
    assert row["cloud"] == pytest.approx(found.chamfer, rel=1e-3)
    # The chart is the sensor plane: from the true surface to it is the depth, from it to the surface is more.
    felt = touch["depth"][index][np.isfinite(touch["depth"][index])].astype(float)
    assert row["chart"] == pytest.approx(9000 * 2 * (felt**2).mean(), rel=0.1)


def test_a_touch_chart_without_area_is_scored_by_its_vertices(run):
    """A contact of a single pixel leaves one: in the run of the paper's counts bottle-0128 has such a touch."""
    grasp = Dataset(run, ["touch", "charts"])["ball-0002"].grasps[1]
    sensors = np.flatnonzero(grasp.success)
    vertices = grasp.vertices.copy()
    vertices[sensors[1]] = point = grasp.position[sensors[1]]
    model, empty = TouchDepth(width=4).eval(), np.zeros((100, 100, 3), np.uint8)
    with mock.patch.object(type(grasp), "vertices", vertices, create=True):
        _, charts = evaluation._local_scores(model, grasp, sensors, empty, 1000, seeded(0, "a"))
    squared = ((grasp.points[sensors[1]] - point) ** 2).sum(axis=1)
    assert charts[1] == pytest.approx(9000 * (squared.min() + squared.mean()), rel=1e-3)
    assert np.isfinite(charts).all() and len(charts) == len(sensors)


def test_a_split_without_objects_is_an_error(data, run):
    arrays = {"object": np.array(["a"]), "class": np.array(["b"]), "split": np.array(["train"])}
    arrays |= {"points": data["points"][:1], "unoccluded": data["occluded"][:1, 0], "image_camera": CAMERAS[:1]}
    alone = ExperimentData(arrays)
    with pytest.raises(EvaluationError, match="no object in validation or test"):
        evaluate(untrained(UNOCCLUDED), alone)
    with pytest.raises(EvaluationError, match="no successful touch in nonsense"):
        evaluate_touch(TouchDepth(width=4).eval(), 1, Dataset(run, ["touch", "charts"]), splits=["nonsense"])


def test_a_prediction_that_is_not_finite_names_the_object(unoccluded_data):
    trained = untrained(UNOCCLUDED)
    with torch.no_grad():
        for parameter in trained.model.gcn.parameters():
            parameter.fill_(float("nan"))
    with pytest.raises(EvaluationError, match="model seed 3: the prediction for ball-0001 is not finite"):
        evaluate(trained, unoccluded_data)


def test_the_steps_are_those_of_the_training(tmp_path):
    (tmp_path / "training.json").write_text(json.dumps({"steps": 450, "best_step": 300}))
    assert training_steps(tmp_path / "training.json") == 450


@pytest.mark.parametrize("content", [None, "", '{"steps": 4', '{"step": 4}', '{"steps": "many"}', "[4]"])
def test_a_record_that_does_not_say_the_steps_is_named_with_the_remedy(tmp_path, content):
    path = tmp_path / "models/a/seed-0/training.json"
    path.parent.mkdir(parents=True)
    if content is not None:
        path.write_text(content)
    with pytest.raises(EvaluationError, match=f"{path} .*(build it|again) with: snakemake models/a/seed-0/"):
        training_steps(path)


@pytest.mark.parametrize("content", [b"", b"\xff\n", b"chamfer\n1\n", b"a,b\n1,2,3\n1,2,3,4\n", b"chamfer\n1"])
def test_an_evaluation_that_is_no_table_is_named_with_the_remedy(tmp_path, content):
    path = tmp_path / "evaluations/a/seed-0.csv"
    path.parent.mkdir(parents=True)
    path.write_bytes(content)
    with pytest.raises(EvaluationError, match=f"(?s){path} .*build it again with: snakemake evaluations/a/seed-0.csv"):
        read([path])


def test_what_is_measured_is_read_back(tmp_path, unoccluded_data):
    table = evaluate(untrained(UNOCCLUDED), unoccluded_data, points=300)
    table.to_csv(tmp_path / "seed-3.csv", index=False)
    pd.testing.assert_frame_equal(pd.read_csv(tmp_path / "seed-3.csv"), table)


def test_an_image_of_several_windows_is_encoded_once(data, unoccluded_data):
    """As many images as objects go through the encoder, and every window's score is that of a model's own call."""
    experiment = Experiment("model", "charts", "unoccluded", True, 1)
    arrays = {name: data[name] for name in ("points", "success", "position", "rotation", "charts")}
    arrays |= {"object": data.objects, "class": data.classes, "split": data.splits}
    both = ExperimentData(arrays | {"unoccluded": unoccluded_data["unoccluded"], "image_camera": CAMERAS})
    trained, encoded = untrained(experiment), []
    trained.model.encoder.layers[0].register_forward_pre_hook(lambda _, images: encoded.append(len(images[0])))
    table = evaluate(trained, both, points=300)
    assert len(table) == 3 * GRASPS and sum(encoded) == 3
    for row in table.to_dict("records"):
        number, grasp = both.objects.index(row["object"]), row["window"]
        keys = ("success", "position", "rotation", "charts")
        batch = {key: torch.from_numpy(both[key][number, grasp])[None] for key in keys}
        batch["image"] = torch.from_numpy(both["unoccluded"][number, 0]).permute(2, 0, 1)[None].float() / 255
        batch["camera"] = torch.from_numpy(CAMERAS[0])
        with torch.inference_mode():
            vertices = trained.model(batch)
        points = sample_faces(vertices, trained.model.faces, 300, seeded(0, row["object"], "evaluation"))[0]
        pairs = torch.cdist(points.double(), torch.from_numpy(both["points"][number]).double()) ** 2
        assert row["chamfer"] == pytest.approx(float(9000 * (pairs.amin(0).mean() + pairs.amin(1).mean())), rel=1e-3)


@pytest.fixture(scope="module")
def touched_data(data, unoccluded_data) -> ExperimentData:
    names = {"object": data.objects, "class": data.classes, "split": data.splits}
    names["unoccluded_silhouette"] = np.random.default_rng(0).random((len(SPLITS), 1, 256, 256)) < 0.5
    both = {name: np.array(values) for name, values in names.items()} | data.arrays | unoccluded_data.arrays
    return ExperimentData({name: values for name, values in both.items() if name != "occluded"})


@pytest.mark.parametrize("vision", ["none", "unoccluded"])
def test_chosen_grasps_are_measured_as_any_others(touched_data, vision):
    """All strategies begin at the same error, and end at the same one, with both grasps; the oracle is never above
    another where it has a choice. What one grasp leaves is what an evaluation of that grasp says."""
    takes = {"strategy": "template", "vision": vision, "touch": True, "correction": Correction(0.08, 0.3)}
    known = templates(vision != "none")[0]
    trained = untrained(Experiment("model", grasps=2, fewer_grasps=True, **takes), known)
    table = evaluate_selection(trained, touched_data, ["test"], points=500)
    assert list(table.columns) == list(SELECTION_COLUMNS) and set(table["object"]) == {"ball-0002", "ball-0003"}
    counts = [0, 1, 2] if vision == "unoccluded" else [1, 2]
    one = trained._replace(experiment=Experiment("model", grasps=1, **takes))
    alone = evaluate(one, touched_data, 500, ["test"]).set_index(["object", "window"])["chamfer"]
    for name, rows in table.groupby("object"):
        error = rows.pivot(index="strategy", columns="grasps", values="chamfer")
        assert list(error.columns) == counts and set(error.index) == {"random", "farthest", "uncertainty", "oracle"}
        for count in (counts[0], 2):
            np.testing.assert_allclose(error[count], error.loc["oracle", count], rtol=1e-4)
        assert error.loc["oracle", 1] == pytest.approx(error[1].min())
        order = generator(3, name, "selection").permutation(GRASPS)
        assert error.loc["random", 1] == pytest.approx(alone[name, order[0]], rel=1e-4)
        if vision == "unoccluded":
            assert error.loc["oracle", 1] == pytest.approx(alone[name].min(), rel=1e-4)
    with pytest.raises(EvaluationError, match="of two and more"):
        evaluate_selection(one, touched_data, ["test"])
