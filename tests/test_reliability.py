"""The table of docs/evidence/reliability.md names tests that exist."""

import ast
import re
from pathlib import Path

ROOT = Path(__file__).parents[1]
PROMISES = [
    line.split(" | ")
    for line in (ROOT / "docs/evidence/reliability.md").read_text(encoding="utf-8").split("\n## ")[1].splitlines()
    if line.startswith("| ") and not line.startswith(("| what", "| **"))
]


def test_each_promise_has_a_test_that_exists():
    assert len(PROMISES) > 30
    for happens, promised, tests in PROMISES:
        named = re.findall(r"`(tests/[\w/]+\.py)::(test_\w+)`", tests)
        assert promised.strip() and named and len(named) == tests.count("`") / 2, happens
        for file, function in named:
            tree = ast.parse((ROOT / file).read_text(encoding="utf-8"))
            assert function in {node.name for node in tree.body if isinstance(node, ast.FunctionDef)}, (happens, file)
