"""Models used on records of a dataset, against the same models on the data they are trained on."""

import re
import shutil

import numpy as np
import pytest
import torch
import trimesh
import zarr

import palpate
from palpate import command, seal, store, vision
from palpate.architectures import Architecture
from palpate.camera import looking_at, matrices, paper_camera
from palpate.charts import sphere
from palpate.dataset import Dataset
from palpate.experiments import Experiment
from palpate.learning import checkpoints, reconstruct
from palpate.learning.checkpoints import CheckpointError
from palpate.learning.data import ExperimentData
from palpate.learning.reconstruct import GraspTouches, ReconstructionError, Reconstructor
from palpate.learning.samples import Assembler, Sample
from palpate.learning.touch_charts import touch_charts
from palpate.mesh import OBJECT_POSITION
from palpate.models import SINGLE_IMAGE_MODELS, TouchDepth
from palpate.models.templates import MASK, Templates
from palpate.store import StoreError
from palpate.strategies import STRATEGIES, Strategy
from tests.models.batches import SMALL
from tests.results.conftest import ATTRIBUTES, BATCH, build_run

ARCHITECTURE = SMALL | {"gcn": {"layers": 3, "width": 12}, "last_layer_scale": 1.0}
ARCHITECTURE |= {
    "encoder": SMALL["encoder"] | {"padding": 1},
    "decoder": {"hidden": 8, "points": 50, "channels": [4, 4, 4, 4], "level": 0.5},
}
EXPERIMENTS = {
    each.name: each
    for each in (
        Experiment("charts_occluded_touch", "charts", "occluded", True, 1),
        Experiment("no_copy_unoccluded_touch", "no_copy", "unoccluded", True, 1),
        Experiment("no_comm_unoccluded_touch", "no_comm", "unoccluded", True, 1),
        Experiment("sphere_occluded_touch", "sphere", "occluded", True, 1),
        Experiment("charts_occluded", "charts", "occluded", False, 1),
        Experiment("charts_touch_2", "charts", "none", True, 2),
        Experiment("template_unoccluded_touch", "template", "unoccluded", True, 1),
        Experiment("template_occluded_touch", "template", "occluded", True, 1),
        Experiment("template_touch_2", "template", "none", True, 2),
        Experiment("not_copied_touch_2", "not_copied", "none", True, 2),
        Experiment("single_image", "charts", "views", False, 1),
        Experiment("single_image_psg", "psg", "views", False, 1),
        Experiment("single_image_pixel2mesh", "pixel2mesh", "views", False, 1),
        Experiment("single_image_r2n2", "r2n2", "views", False, 1),
    )
}
VIEWS, VIEW_SIZE = 2, 137
OBJECT_CENTRE = torch.tensor(OBJECT_POSITION)


@pytest.fixture(scope="module", autouse=True)
def not_copied():
    """Charts with features of the nearest touches, none of which are in the mesh: no strategy of ours."""
    with pytest.MonkeyPatch.context() as patched:
        patched.setitem(STRATEGIES, "not_copied", Strategy(touch_input="pooled"))
        yield


def noisy_images(meshes, hand, grasp):
    """Images of noise by two cameras: models that take them right predict what they do on the training data."""
    rng = np.random.default_rng(len(str(meshes)))
    count = len(grasp["palm_pose"])
    return {
        "unoccluded": rng.integers(0, 256, (2, 256, 256, 3), np.uint8),
        "occluded": rng.integers(0, 256, (count, 2, 256, 256, 3), np.uint8),
        "unoccluded_mask": 255 * rng.integers(0, 2, (2, 256, 256), np.uint8),
        "occluded_mask": 255 * rng.integers(0, 2, (count, 2, 256, 256), np.uint8),
        "unoccluded_depth": np.ones((2, 256, 256), np.float16),
        "occluded_depth": np.ones((count, 2, 256, 256), np.float16),
        **matrices([paper_camera(), looking_at(OBJECT_POSITION, (-0.4, 0.9, 1.1))]),
    }


def random_templates(experiment):
    """Spheres of two sizes, and noise for their silhouettes by both cameras."""
    vertices = torch.stack([OBJECT_CENTRE + size * (sphere()[0] - OBJECT_CENTRE) for size in (0.5, 0.9)])
    masks = torch.randint(0, 256, (2, 2, MASK, MASK), dtype=torch.uint8)
    return Templates(vertices, masks if experiment.has_vision else None)


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    """A run of two objects with untrained models, and the stores that they are trained on."""
    folder = tmp_path_factory.mktemp("reconstruct") / "run"
    build_run(folder, ["bottle-0000", "knife-0000"], vision=noisy_images)
    torch.manual_seed(0)
    unet = TouchDepth(width=4).eval()
    checkpoints.save(folder / "models/touch_depth/best.ckpt", "touch_depth", unet, {"width": 4})
    for seed, (name, experiment) in enumerate(EXPERIMENTS.items()):
        torch.manual_seed(seed)
        known = random_templates(experiment) if experiment.strategy == "template" else None
        model = checkpoints.build(experiment, Architecture.from_row(ARCHITECTURE), templates=known)
        if experiment.plan.touch_input == "pooled":  # weights that start at zero
            torch.nn.init.normal_(model.touch_pooling.weight)
        if experiment.strategy == "r2n2":  # untrained, all cells are as probable, whatever the image
            torch.nn.init.normal_(model.cells.weight, std=1e3)
        # As if it had been trained on images of the first camera only.
        camera = None if experiment.vision == "views" else vision.paper_camera().matrix().tolist()
        described = {"experiment": experiment.row(), "architecture": ARCHITECTURE, "camera": camera, "image_size": 256}
        checkpoints.save(folder / f"models/{name}/seed-0/best.ckpt", "reconstruction", model, described)
    touch = store.read(folder / f"touch/{BATCH}.zarr")
    sensors = [touch[key] for key in ("success", "position", "rotation")]
    rows = zip(touch["reading"], *sensors, strict=True)  # by themselves, as the pipeline
    vertices = np.stack([touch_charts(unet, reading, touch["empty_reading"], *of_row) for reading, *of_row in rows])
    charts = {"object": touch["object"], "vertices": vertices}
    store.write(folder / f"charts/{BATCH}.zarr", "charts", charts, ATTRIBUTES)
    rng, count = np.random.default_rng(0), len(touch["object"])
    views = {
        "object": touch["object"],
        "image": rng.integers(0, 256, (count, VIEWS, VIEW_SIZE, VIEW_SIZE, 3), np.uint8),
        "mask": np.zeros((count, VIEWS, VIEW_SIZE, VIEW_SIZE), np.uint8),
        "camera": np.tile(camera_matrix(), (count, VIEWS, 1, 1)),
    }
    store.write(folder / f"views/{BATCH}.zarr", "views", views, ATTRIBUTES)
    return folder


def camera_matrix():
    camera = vision.paper_camera(VIEW_SIZE)
    return camera.intrinsics() @ camera.extrinsics()


@pytest.fixture
def dataset(run):
    return Dataset(run)


def folder_of(run, name):
    return run / "models" / name / "seed-0"


def of_data(run, name, sample):
    """Vertices and faces that the model predicts for a sample of its training data."""
    experiment = EXPERIMENTS[name]
    model = checkpoints.load(folder_of(run, name) / "best.ckpt")
    with torch.inference_mode():
        batch = Assembler(ExperimentData.load(run, experiment), experiment)([sample])
        vertices, faces = model.meshes(batch)[0]
        return vertices.numpy(), faces.numpy()


@pytest.mark.parametrize(
    "name, grasps, view",
    [
        ("charts_occluded_touch", (1,), 0),
        ("no_copy_unoccluded_touch", (0,), 0),
        ("sphere_occluded_touch", (1,), 0),
        ("charts_occluded", (1,), 0),
        ("charts_occluded", (1,), 1),
        ("no_copy_unoccluded_touch", (0,), 1),
        ("charts_touch_2", (1, 0), 0),
        ("template_touch_2", (1, 0), 0),
        ("not_copied_touch_2", (1, 0), 0),
        ("template_unoccluded_touch", (1,), 1),
        ("template_occluded_touch", (1,), 1),
        ("single_image", (), 1),
    ],
)
def test_a_record_gives_what_its_training_data_give(run, dataset, name, grasps, view):
    """Two ways from the stores to a prediction: by record and U-Net, and by charts store and training data."""
    model = Reconstructor(folder_of(run, name))
    record = dataset["knife-0000"]
    shape = model.predict(record, grasps or None, view)
    vertices, faces = of_data(run, name, Sample(1, grasps, view))
    np.testing.assert_allclose(shape.vertices, vertices, atol=1e-6)
    if model.experiment.strategy == "template":  # copied charts without success, all at one place, are left out
        faces = faces[(vertices[faces] != vertices[faces[:, :1]]).any(axis=(1, 2))]
    np.testing.assert_array_equal(shape.faces, faces)
    assert vertices.std(axis=0).min() > 0.01  # the prediction is a shape, and another object's is another
    other, _ = of_data(run, name, Sample(0, grasps, view))
    assert np.abs(other - vertices).max() > 1e-4


@pytest.mark.parametrize("name", ["template_unoccluded_touch", "template_occluded_touch"])
def test_a_closed_surface_has_what_the_silhouette_shows_to_be_empty_space(run, dataset, name):
    model = Reconstructor(folder_of(run, name))
    *given, silhouette = reconstruct.of_object(dataset["knife-0000"], model.experiment, [1])
    for network in (model._model.gcn, model._model.sphere_gcn):  # what it begins with: untrained it leaves the image
        for parameter in network.layers[-1].parameters():
            torch.nn.init.zeros_(parameter)
    mask = np.ones((256, 256), bool)
    mask[100:150, 100:150] = False  # seen through
    silhouette = silhouette._replace(mask=mask, hand=None)
    cut, closed = (model(*given, silhouette, closed) for closed in (False, True))
    np.testing.assert_allclose(cut.vertices, closed.vertices, rtol=0, atol=0.005)  # smoothed where it is closed
    assert {tuple(face) for face in cut.faces} < {tuple(face) for face in closed.faces}
    assert cut.touch.sum() == closed.touch.sum() > 0 and len(closed.faces) == 2304 + closed.touch.sum()
    for shape, watertight in ((cut, False), (closed, True)):
        mesh = trimesh.Trimesh(shape.vertices, shape.faces[~shape.touch])
        assert mesh.is_watertight == watertight


@pytest.mark.parametrize("strategy", SINGLE_IMAGE_MODELS)
def test_a_view_gives_what_a_published_network_predicts_for_it(run, dataset, strategy, tmp_path):
    """Its mesh, or its points without faces, and that as a file."""
    name = f"single_image_{strategy}"
    model = Reconstructor(folder_of(run, name))
    image, touches, camera, _ = reconstruct.of_object(dataset["knife-0000"], model.experiment, None, 1)
    shape = model(image, touches, camera)
    vertices, faces = of_data(run, name, Sample(1, (), 1))
    np.testing.assert_allclose(shape.vertices, vertices, atol=1e-6)
    np.testing.assert_array_equal(shape.faces, faces)
    assert len(vertices) and (len(faces) > 0) == (strategy != "psg")
    other, _ = of_data(run, name, Sample(1, (), 0))
    assert other.shape != vertices.shape or np.abs(other - vertices).max() > 1e-5
    mesh = reconstruct.reconstruct(image, camera=camera, model=folder_of(run, name))
    mesh.export(tmp_path / "x.ply")
    read = trimesh.load(tmp_path / "x.ply", process=False)
    np.testing.assert_allclose(read.vertices, vertices, atol=1e-6)


@pytest.mark.parametrize("name", ["no_comm_unoccluded_touch", "template_occluded_touch"])
def test_charts_without_touch_are_left_out_where_they_are_only_copied(run, dataset, name):
    grasp = next(g for g in dataset["knife-0000"].grasps if 0 < g.success.sum() < 4)
    shape = Reconstructor(folder_of(run, name)).predict(grasp.object, [grasp.number])
    vertices, faces = of_data(run, name, Sample(1, (grasp.number,)))
    np.testing.assert_allclose(shape.vertices, vertices, atol=1e-6)
    triangles = vertices[faces]
    normal = np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0])
    gone = {tuple(face) for face in faces} - {tuple(face) for face in shape.faces}
    assert gone and len(gone) == 128 * (4 - grasp.success.sum())
    points = {tuple(face) for face in faces[(normal == 0).all(axis=1)]}
    assert gone <= points
    assert shape.touch.sum() == 128 * grasp.success.sum()


def test_touch_faces_are_the_charts_at_the_touches(run, dataset):
    """Where charts are enforced, the marked faces lie where sensors touched, and only these."""
    grasp = max(dataset["bottle-0000"].grasps, key=lambda g: g.success.sum())
    model = Reconstructor(folder_of(run, "charts_occluded_touch"))
    shape = model(grasp.occluded, grasp)
    assert shape.touch.sum() == 128 * grasp.success.sum() > 0
    charts = reconstruct.TouchCharts(run / "models/touch_depth")(grasp)
    marked = shape.vertices[np.unique(shape.faces[shape.touch])]
    np.testing.assert_allclose(marked, charts[grasp.success].reshape(-1, 3), atol=1e-7)


def test_predicted_clouds_lie_where_charts_do(run, dataset):
    """Over the sensor's plane, and as far from it as the charts that are fitted to them."""
    grasp = max(dataset["bottle-0000"].grasps, key=lambda g: g.success.sum())
    predicted = reconstruct.TouchCharts(run / "models/touch_depth")
    clouds, charts = predicted.clouds(grasp), predicted(grasp)[grasp.success]
    poses = zip(grasp.position[grasp.success], grasp.rotation[grasp.success], strict=True)
    assert len(clouds) == len(charts) > 0
    for cloud, chart, (position, rotation) in zip(clouds, charts, poses, strict=True):
        local = (cloud - position) @ rotation
        assert np.abs(local[:, 1:]).max() < 0.01641 / 2
        depth, of_chart = local[:, 0], ((chart - position) @ rotation)[:, 0]
        assert depth.min() - 1e-4 < of_chart.min() <= of_chart.max() < depth.max() + 1e-4


@pytest.mark.parametrize("suffix", reconstruct.FORMATS)
def test_the_command_writes_the_mesh_with_its_colours(run, dataset, tmp_path, suffix, capsys):
    path = tmp_path / "new" / f"x{suffix}"
    arguments = [str(run), "charts_occluded_touch", "bottle-0000", "--grasp", "1", "--output", str(path)]
    assert command.main(["reconstruct", *arguments]) == 0
    assert str(path) in capsys.readouterr().out
    grasp = dataset["bottle-0000"].grasps[1]
    expected = palpate.reconstruct(grasp.occluded, grasp, model=folder_of(run, "charts_occluded_touch"))
    written = trimesh.load(path, process=False, force="mesh")
    np.testing.assert_allclose(written.vertices, expected.vertices, atol=1e-6)
    np.testing.assert_array_equal(written.faces, expected.faces)
    colours = np.unique(np.asarray(written.visual.vertex_colors)[:, :3], axis=0)
    np.testing.assert_array_equal(colours, [[143, 194, 230], [214, 94, 0]])
    assert np.abs(np.median(written.vertices, axis=0) - (0, 0, 0.6)).max() < 0.3  # the world frame


@pytest.mark.parametrize("name", ["charts_occluded", "charts_touch_2", "single_image"])
def test_predictions_of_all_grasps_are_those_of_each(run, dataset, name):
    model, record = Reconstructor(folder_of(run, name)), dataset["bottle-0000"]
    found = model.predictions(record)
    assert list(found) == [0, 1]
    for number, mesh in found.items():
        of_one = name == "charts_occluded"
        expected = model(*reconstruct.of_object(record, model.experiment, [number] if of_one else None)).mesh()
        np.testing.assert_array_equal(mesh.vertices, expected.vertices)
    assert list(model.predictions(record, [1])) == [1]
    assert (found[0] is found[1]) == (name != "charts_occluded")


def test_a_grasp_that_touches_nothing_is_reconstructed_with_a_warning(run, dataset):
    grasp = dataset["bottle-0000"].grasps[0]
    nothing = GraspTouches(grasp.reading, grasp.position, grasp.rotation, np.zeros(4, bool))
    with pytest.warns(UserWarning, match="no sensor of 1 grasp touches"):
        shape = Reconstructor(folder_of(run, "charts_occluded_touch"))(grasp.occluded, nothing)
    assert not shape.touch.any() and np.isfinite(shape.vertices).all()


def test_a_model_that_is_not_there_is_answered_with_those_that_are(run):
    with pytest.raises(ReconstructionError, match=r"charts_tuch.*does not exist; trained are: charts_occluded/"):
        Reconstructor(run / "models/charts_tuch/seed-0")
    with pytest.raises(ReconstructionError, match="seed-7.*does not exist; trained are"):
        Reconstructor(folder_of(run, "charts_occluded").parent / "seed-7")
    with pytest.raises(ReconstructionError, match="nothing is trained there; train it with: snakemake"):
        Reconstructor("nowhere/models/charts_touch/seed-0")


@pytest.mark.parametrize(
    "arguments, message",
    [
        (
            ["charts_tuch", "bottle-0000", "--output", "x.ply"],
            "'charts_tuch' is trained .* charts_occluded/seed-0, .*; did you mean 'charts_touch_2'",
        ),
        (["charts_occluded", "bottle-0000", "--seed", "3", "--output", "x.ply"], "seed-3.* trained are"),
        (["charts_occluded", "teapot-0000", "--output", "x.ply"], "'teapot-0000' is not among"),
        (["charts_occluded", "bottle-0000", "--grasp", "9", "--output", "x.ply"], "no grasp 9: it has 2"),
        (
            ["charts_touch_2", "bottle-0000", "--grasp", "0", "--output", "x.ply"],
            "takes 2 grasps, .* of 1 were",
        ),
        (["single_image", "bottle-0000", "--view", "9", "--output", "x.ply"], "no view 9: it has 2"),
        (["charts_occluded", "bottle-0000", "--output", "x.png"], "must end in one of .ply"),
        (
            ["charts_occluded", "bottle-0000", "--device", "cuda:99", "--output", "x.ply"],
            r"'cuda:99' can't .*: use cpu",
        ),
        (["charts_occluded", "bottle-0000", "--device", "gpu", "--output", "x.ply"], r"device 'gpu' can't .*: use cpu"),
    ],
)
def test_the_command_says_what_is_wrong(run, arguments, message, capsys, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert command.main(["reconstruct", str(run), *arguments]) == 1
    said = capsys.readouterr().err
    assert re.search(message, said), said
    assert said.count("\n") == 1 and not list(tmp_path.iterdir())


def bad(array, value):
    array = array.astype(float)
    array.flat[-1] = value
    return array


@pytest.mark.parametrize(
    "name, change, message",
    [
        ("charts_occluded_touch", {"image": None}, "takes an image .occluded vision.: give one"),
        ("charts_occluded_touch", {"touches": None}, "takes 1 grasp, but touches of 0"),
        ("charts_occluded_touch", {"touches": lambda g: [g, g]}, "takes 1 grasp, but touches of 2"),
        ("charts_occluded", {"image": lambda i: i[:200]}, r"shape \(200, 256, 3\), expected \(s, s, 3\)"),
        ("charts_occluded", {"image": lambda i: i[..., :1]}, r"shape \(256, 256, 1\)"),
        ("charts_occluded", {"image": lambda i: bad(i, np.nan)}, "the image has NaN"),
        ("charts_occluded", {"image": lambda i: i / 255}, "type float64, expected uint8"),
        ("charts_touch_2", {"position": lambda a: bad(a, np.nan)}, "touches: position has NaN"),
        ("charts_touch_2", {"rotation": lambda a: bad(a, np.inf)}, "touches: rotation has NaN or infinite"),
        ("charts_touch_2", {"rotation": lambda a: a * 0}, "touches: rotation must be rotation matrices: orthonormal"),
        ("charts_touch_2", {"rotation": lambda a: a * 1.1}, "touches: rotation must be rotation matrices: orthonormal"),
        ("charts_touch_2", {"rotation": lambda a: -a}, "touches: rotation must be rotation matrices: .* determinant 1"),
        ("charts_touch_2", {"reading": lambda a: bad(a, np.nan)}, "touches: reading has NaN"),
        (
            "charts_touch_2",
            {"reading": lambda a: a[:, :50]},
            r"reading of 2 grasps has shape \(8, 50, 100, 3\)",
        ),
        (
            "charts_touch_2",
            {"success": lambda a: a[:3]},
            r"success of 2 grasps has shape \(6,\), expected \(8,\)",
        ),
        ("single_image", {"camera": None}, "was trained on several cameras: give the image's camera"),
        ("charts_occluded", {"camera": lambda c: c * 0}, "invalid camera: its projection"),
        ("charts_occluded", {"camera": lambda c: c * [[1], [1], [0]]}, "invalid camera: its projection"),
        ("charts_occluded", {"camera": lambda c: c[:2]}, r"the image's camera \(3, 4\), .* array of shape \(2, 4\)"),
        ("single_image", {"camera": lambda c: bad(c, np.nan)}, "the camera has NaN"),
    ],
)
def test_what_is_missing_or_wrong_is_said(run, dataset, name, change, message):
    model = Reconstructor(folder_of(run, name))
    record = dataset["bottle-0000"]
    image, touches, camera, _ = reconstruct.of_object(record, model.experiment)
    given = {"image": image, "touches": touches, "camera": camera}
    ((key, how),) = change.items()
    if key in given:
        value = given[key][0] if key == "touches" else given[key]
        given[key] = how if how is None else how(value)
    else:
        given["touches"] = [
            GraspTouches(*(getattr(g, field) for field in GraspTouches._fields))._replace(**{key: how(getattr(g, key))})
            for g in touches
        ]
    with pytest.raises(ReconstructionError, match=message):
        model(**given)


def test_a_silhouette_that_is_missing_or_of_another_size(run, dataset):
    model = Reconstructor(folder_of(run, "template_occluded_touch"))
    image, touches, camera, silhouette = reconstruct.of_object(dataset["bottle-0000"], model.experiment)
    assert silhouette.mask.any() and silhouette.hand.any() and not (silhouette.mask & silhouette.hand).any()
    with pytest.raises(ReconstructionError, match="also takes the object's silhouette in the image"):
        model(image, touches, camera)
    with pytest.raises(
        ReconstructionError, match=r"the silhouette's hand has shape \(3, 256\), expected .*\(256, 256\)"
    ):
        model(image, touches, camera, silhouette._replace(hand=silhouette.hand[:3]))


def test_an_image_without_its_camera_is_of_the_one_that_the_model_was_trained_on(run, dataset):
    model, record = Reconstructor(folder_of(run, "charts_occluded")), dataset["bottle-0000"]
    image, _, camera, _ = reconstruct.of_object(record, model.experiment, (0,))
    np.testing.assert_array_equal(model(image).vertices, model(image, camera=camera).vertices)
    other, _, second, _ = reconstruct.of_object(record, model.experiment, (0,), 1)
    assert np.abs(second - camera).max() > 0.1 and (other != image).any()
    assert np.abs(model(other, camera=second).vertices - model(other).vertices).max() > 1e-5
    with pytest.raises(ReconstructionError, match=r"\(128, 128, 3\), expected \(256, 256, 3\); .*, give its camera"):
        model(image[::2, ::2])
    half = np.diag([0.5, 0.5, 1]) @ camera
    assert np.isfinite(model(image[::2, ::2], camera=half).vertices).all()
    with pytest.raises(ReconstructionError, match="no camera 2: it has 2, numbered from 0"):
        reconstruct.of_object(record, model.experiment, (0,), 2)


def test_an_image_with_opacity_is_taken_over_white(run, dataset):
    model, grasp = Reconstructor(folder_of(run, "charts_occluded")), dataset["bottle-0000"].grasps[0]
    opacity = np.zeros((256, 256, 1), np.uint8)
    opacity[:100] = 255
    white = np.where(opacity, grasp.occluded, 255)
    found = model(np.concatenate([grasp.occluded, opacity], axis=2))
    np.testing.assert_allclose(found.vertices, model(white).vertices, atol=1e-6)
    assert np.abs(found.vertices - model(grasp.occluded).vertices).max() > 1e-5


def test_charts_that_are_not_finite_are_an_error(run, dataset):
    model = Reconstructor(folder_of(run, "charts_touch_2"))
    next(model._charts.model.parameters()).data.fill_(float("nan"))
    with pytest.raises(ReconstructionError, match="no touch charts from what .*best.ckpt predicts: .*NaN"):
        model(touches=dataset["bottle-0000"].grasps)


def copy_of(run, tmp_path, name, **changes):
    held = torch.load(folder_of(run, name) / "best.ckpt", weights_only=True)
    path = tmp_path / "models" / name / "seed-0" / "best.ckpt"
    path.parent.mkdir(parents=True)
    torch.save({**held, **changes}, path)
    seal.write(path)
    return path


def test_a_checkpoint_of_another_architecture_schema_or_kind_is_refused(run, tmp_path):
    wider = ARCHITECTURE | {"gcn": {"layers": 3, "width": 15}}
    with pytest.raises(CheckpointError, match="holds another model"):
        Reconstructor(copy_of(run, tmp_path / "a", "charts_occluded", architecture=wider))
    with pytest.raises(CheckpointError, match="schema version 99"):
        Reconstructor(copy_of(run, tmp_path / "b", "charts_occluded", schema_version=99))
    with pytest.raises(CheckpointError, match="of kind touch_depth"):
        Reconstructor(run / "models/touch_depth")


def test_a_run_without_its_u_net_is_said_to_have_none(run, tmp_path):
    model = copy_of(run, tmp_path, "charts_touch_2")
    missing = pytest.raises(ReconstructionError, match="touch_depth/best.ckpt does not exist: the U-Net")
    with missing:
        Reconstructor(model)
    with missing:
        reconstruct.TouchCharts(tmp_path / "models/touch_depth")


def test_a_checkpoint_is_read_once(run, monkeypatch):
    verify, read = seal.verify, []
    monkeypatch.setattr(seal, "verify", lambda path: (read.append(str(path)), verify(path)))
    Reconstructor(run / "models/charts_occluded/seed-0")
    assert len(read) == 1


def test_a_model_that_takes_no_charts_needs_no_u_net(run, dataset, tmp_path):
    path = copy_of(run, tmp_path, "sphere_occluded_touch")
    grasp = dataset["bottle-0000"].grasps[0]
    assert not Reconstructor(path)(grasp.occluded, grasp).touch.any()


def test_a_dataset_of_another_schema_is_refused(run, tmp_path, capsys):
    copy = shutil.copytree(run, tmp_path / "copy")
    zarr.open_group(copy / f"touch/{BATCH}.zarr", mode="r+").attrs["schema_version"] = 99
    with pytest.raises(StoreError, match="schema version 99"):
        Dataset(copy)["bottle-0000"].grasps[0].reading  # noqa: B018
    arguments = [str(copy), "charts_touch_2", "bottle-0000", "--output", str(tmp_path / "x.ply")]
    assert command.main(["reconstruct", *arguments]) == 1
    assert "schema version 99" in capsys.readouterr().err
