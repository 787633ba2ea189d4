"""Configs as they are read, apart from what their schemas say."""

import pytest
import yaml
from snakemake.cli import parse_config

from palpate import sensor
from palpate.configuration import ConfigError, check, in_order, read_yaml, typed, whole_numbers


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("seed: 0\nrun: a\nseed: 1\n", "line 1: key 'seed' stands twice"),
        ("grasps:\n  attempts: 5\n  attempts: 6\n", "line 2: key 'attempts' stands twice"),
        ("a: " + "[" * 600 + "]" * 600, "nested too deep"),
        ("run: &a [*a]\n", "line 1: this value contains itself"),
        ("seed: 0\ntuning: &a\n  grid: *a\n", "line 2: this value contains itself"),
        ("---\n&a\nrun: x\nsplit: [1, {b: *a}]\n", "line 2: this value contains itself"),
        ("split: &a\n  <<: *a\n  train: 3\n", "line 1: this value contains itself"),
        ("run: a\0b\n", "characters are not allowed"),
    ],
    ids=["twice", "twice below", "deep", "list", "mapping", "document", "merged", "NUL"],
)
def test_yaml_that_can_not_be_meant(tmp_path, text, said):
    path = tmp_path / "sensor.yaml"
    path.write_text(text)
    for read in (read_yaml, sensor.read):
        with pytest.raises(ConfigError, match=f"{path}: can't be read as YAML: .*") as error:
            read(path)
        assert said in str(error.value) and "\n" not in str(error.value)


def test_yaml_that_repeats_itself_is_read(tmp_path):
    path = tmp_path / "a.yaml"
    path.write_text("a: &a {x: 1, y: [1, 2]}\nb: *a\nc: {<<: *a, x: 2}\nd: &d []\ne: [*d, *d]\n")
    assert read_yaml(path) == yaml.safe_load(path.read_text())
    path.write_text("")
    assert read_yaml(path) is None


def test_whole_numbers_are_integers():
    config = {"seed": 1.0, "split": {"train": 2.5}, "seeds": [0.0, 1], "on": True, "far": 1e300, "name": "1.0"}
    assert repr(whole_numbers(config)) == repr(
        {"seed": 1, "split": {"train": 2.5}, "seeds": [0, 1], "on": True, "far": 1e300, "name": "1.0"}
    )


@pytest.mark.parametrize(
    ("value", "said"),
    [
        ("demo\n", r"run: 'demo\\n' has a line break"),
        ("a\0b", r"run: 'a\\x00b' has a line break or another control character"),
    ],
    ids=["line break", "NUL"],
)
def test_texts_that_no_file_can_be_called(tmp_path, value, said):
    schema = tmp_path / "schema.yaml"
    schema.write_text('properties: {run: {type: string, pattern: "^[^!]*$"}}')
    with pytest.raises(ConfigError, match=said):
        check({"run": value}, schema, "the config")


@pytest.mark.parametrize(
    "text",
    [
        "{size: 128, exr: true, lights: null, background: white}",
        "[{class: knife, objects: 2}, {class: can, objects: all}]",
        "{lights: [{kind: sun, energy: 2.5, position: [1, -1, 2.0e-3]}], cameras: }",
        "{day: 2024-01-01, words: 'a: b', path: ~/x, brace: '}'}",
    ],
)
def test_values_of_the_command_line_are_typed_as_in_a_file(text):
    given = parse_config([f"key={text}"])["key"]
    expected = yaml.safe_load(text)
    expected = {**expected, "day": "2024-01-01"} if "day" in expected else expected  # a date stays text
    assert typed(given) == expected


def test_what_is_typed_already_stays():
    values = {"a": 1, "b": [2.5, True, None, "text"], "c": {"d": "{"}}
    assert typed(values) == values


def test_keys_come_in_the_order_of_the_defaults():
    ordered = in_order({"z": 1, "b": {"y": 2, "x": [3], "w": 4}, "a": 5}, {"a": 0, "b": {"x": 0, "y": 0}})
    assert ordered == {"a": 5, "b": {"x": [3], "y": 2, "w": 4}, "z": 1}
    assert [*ordered] == ["a", "b", "z"] and [*ordered["b"]] == ["x", "y", "w"]
