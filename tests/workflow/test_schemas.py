"""Config files and experiments are checked before anything runs, in one clear message."""

import copy
import math
from pathlib import Path

import pytest
import yaml
from snakemake.utils import update_config

from palpate.catalogue import assign_split
from palpate.configuration import ConfigError, check
from palpate.experiments import Experiments
from workflow.schemas import document

PROJECT = Path(__file__).parents[2]
SCHEMA = PROJECT / "workflow/schemas/config.schema.yaml"
DEFAULT = yaml.safe_load((PROJECT / "config/config.yaml").read_text())


def overlaid(overlay: dict) -> dict:
    config = copy.deepcopy(DEFAULT)
    update_config(config, overlay)
    return config


@pytest.mark.parametrize("name", ["config", "smoke", "small", "paper", "paper_hard"])
def test_shipped_configs_are_valid(name):
    config = overlaid(yaml.safe_load((PROJECT / f"config/{name}.yaml").read_text()))
    check(config, SCHEMA, name)
    counts = {row["class"]: row["objects"] for row in config["classes"]}
    expected = {
        "config": [20, 20, 20, 20],
        "smoke": [1, 1, 1],
        "small": [60, 60, 60, 60],
        "paper": [487, 416, 493, 335],  # supplement, table of per-class statistics
    }
    expected["paper_hard"] = expected["paper"]
    assert list(counts.values()) == expected[name]


def test_smoke_has_an_object_of_every_split():
    config = overlaid(yaml.safe_load((PROJECT / "config/smoke.yaml").read_text()))
    splits = [assign_split(f"{row['class']}-0000", config["split"]) for row in config["classes"]]
    assert sorted(splits) == ["test", "train", "validation"]


@pytest.mark.parametrize(
    ("overlay", "said"),
    [
        ({"grasps": {"attempst": 3}}, "grasps.attempst: unknown key; did you mean 'attempts'?"),
        ({"sede": 3}, "sede: unknown key; did you mean 'seed'?"),
        (
            {"source": {"kind": "folder", "path": "/meshes"}, "split": {"held_out": "styles"}},
            "source.kind: 'folder': only procedural objects have styles: set split.held_out to objects",
        ),
        (
            {"source": {"kind": "released", "path": "/data", "turned": True}},
            "source.turned: True: released images can't be turned",
        ),
        ({"zzz": 3}, "zzz: unknown key; known keys: run, results, seed"),
        ({"evaluation": {"bootstrap": 9}}, "evaluation.bootstrap: unknown key; known keys: points, resamples"),
        ({"vision": {"background": [1, 1, {"from": 0}]}}, "vision.background.2.to: missing"),
        ({"vision": {"background": [1, 1, {"from": 0, "to": 2}]}}, "vision.background.2.to: 2 is greater than"),
        (
            {"vision": {"cameras": [{"position": {"azimuth": 1, "elevation": 2}}]}},
            "vision.cameras.0.position.distance: missing",
        ),
        (
            {"vision": {"lights": [{"kind": "sun", "energy": {"from": -1, "to": 2}}]}},
            "vision.lights.0.energy.from: -1 is less",
        ),
        ({"vision": {"cameras": []}}, "vision.cameras: [] should be non-empty"),
        ({"vision": {"cameras": [{"target": [0, 0, 0.6]}]}}, "vision.cameras.0.position: missing"),
        ({"vision": {"cameras": [{"position": [1, 2]}]}}, "vision.cameras.0.position: [1, 2] is too short"),
        ({"vision": {"cameras": [{"position": [1, 2, 3], "fov": 3}]}}, "vision.cameras.0.fov: unknown key"),
        ({"vision": {"lights": [{"kind": "spot", "energy": 3}]}}, "vision.lights.0.kind: 'spot' is not one of"),
        ({"vision": {"background": "white"}}, "vision.background: 'white': expected transparent, or sRGB"),
        ({"vision": {"background": [1, 1, 2]}}, "vision.background.2: 2 is greater than the maximum of 1"),
        ({"mesh": {"levels": [1000]}}, "mesh.levels: unknown key; known keys: collision_faces"),
        ({"batch_size": "16"}, "batch_size: '16': expected auto, or a number"),
        ({"batch_size": 1.5}, "batch_size: 1.5 is not of type 'integer'"),
        ({"batch_size": 0}, "batch_size: 0 is less than the minimum of 1"),
        ({"source": {"kind": "shapenet"}}, "source.path: None: set it to the folder of the meshes"),
        ({"source": {"kind": "procedurl"}}, "source.kind: 'procedurl' is not one of"),
        ({"classes": [{"class": "bottle", "objects": -1}]}, "classes.0.objects: -1 is less than the minimum"),
        ({"classes": [{"class": "bottle", "objects": "few"}]}, "classes.0.objects: 'few': expected all"),
        ({"classes": [{"class": "../x", "objects": 1}]}, "classes.0.class: '../x' does not match"),
        ({"classes": "some"}, "classes: 'some': expected all, or a list as"),
        ({"grasps": {"timestep": 0.1}}, "grasps.timestep: 0.1 is greater than the maximum of 0.01"),
        ({"grasps": {"hand": {"mjcf": "hand.xml"}}}, "grasps.hand.sensors: missing"),
        ({"run": "a/b"}, "run: 'a/b' does not match"),
        ({"vision": {"samples": 10**8}}, "vision.samples: 100000000 is greater than the maximum of 65536"),
        ({"classes": [{"class": "bottle", "objects": 10**8}]}, "classes.0.objects: 100000000 is greater than the max"),
        ({"grasps": {"max_penetration": math.nan}}, "grasps.max_penetration: nan is not a finite number"),
        ({"split": {"train": math.nan}}, "split.train: nan is not a finite number"),
        (
            {"training": {"override": {"reconstruction": {"rate": math.nan}}}},
            "training.override.reconstruction.rate: n",
        ),
    ],
)
def test_each_mistake_is_one_clear_line(overlay, said):
    with pytest.raises(ConfigError) as error:
        check(overlaid(overlay), SCHEMA, "config.yaml")
    lines = str(error.value).splitlines()
    assert lines[0] == "config.yaml does not fit config.schema.yaml:"
    assert len(lines) == 2
    assert lines[1].strip().startswith(said)


def bounds(schema: dict, path: str = "") -> dict[str, bool]:
    """Whether each number of a schema has a greatest value, by its path."""
    types = schema.get("type", [])
    found = {}
    if {"integer", "number"} & set([types] if isinstance(types, str) else types):
        found[path] = "maximum" in schema
    children = schema.get("properties", {}) | {key: schema[key] for key in ("items", "else") if key in schema}
    for name, child in children.items():
        found |= bounds(child, f"{path}.{name}")
    return found


def test_every_number_has_a_greatest_value():
    found = bounds(yaml.safe_load(SCHEMA.read_text()))
    assert len(found) > 25
    assert [path for path, bounded in found.items() if not bounded] == []


def test_the_readme_has_a_row_for_each_key_as_the_schema_describes_it():
    text = (PROJECT / "config/README.md").read_text()
    assert text == document.renewed("config/README.md"), "run: python workflow/schemas/document.py"
    sections = {key for key, value in DEFAULT.items() if isinstance(value, dict) and key != "split"}
    keys = [key for key in DEFAULT if key not in sections]
    keys += [f"{section}.{key}" for section in sections for key in DEFAULT[section]]
    assert len(keys) > 50 and all(text.count(f"\n| `{key}` | ") == 1 for key in keys)
    assert "| `grasps.timestep` | `0.004` | time step of MuJoCo, s" in text


@pytest.mark.parametrize("value", [math.inf, -math.inf, math.nan])
def test_numbers_that_are_not_finite_are_refused_in_recipes_too(value):
    recipes = yaml.safe_load((PROJECT / "config/recipes.yaml").read_text())
    recipes["fast"]["reconstruction"]["rate"] = value
    with pytest.raises(ConfigError, match="fast.reconstruction.rate: .* is not a finite number"):
        check(recipes, PROJECT / "workflow/schemas/recipes.schema.yaml", "recipes.yaml")


def test_all_mistakes_are_said_at_once():
    with pytest.raises(ConfigError) as error:
        check(overlaid({"seed": "x", "surface": {"points": "many"}}), SCHEMA, "config.yaml")
    assert len(str(error.value).splitlines()) == 3


def test_experiments_are_valid_and_tables_name_only_what_exists():
    declared = Experiments.read(
        PROJECT / "config/experiments.yaml", PROJECT / "workflow/schemas/experiments.schema.yaml"
    )
    named = {name for table in declared.tables.values() for name in table.by_name}
    weights = {experiment.trained for experiment in declared.experiments.values()}
    assert named | weights == set(declared.experiments)
    ours = [each.method.whose != "paper" for each in declared.tables["model_selection"].by_name.values()]
    assert ours == sorted(ours) and ours.count(False) == 12  # the paper's rows


def test_the_harder_paper_differs_in_nothing_else():
    """From paper.yaml, but for what makes it harder."""
    paper, hard = (yaml.safe_load((PROJECT / f"config/{name}.yaml").read_text()) for name in ("paper", "paper_hard"))
    assert hard == paper | {"run": "paper_hard", "source": {"turned": True}, "split": {"held_out": "styles"}}
