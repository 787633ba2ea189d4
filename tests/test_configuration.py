"""Configs as they are read, apart from what their schemas say."""

import pytest
import yaml
from snakemake.cli import parse_config

from palpate.configuration import typed


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
