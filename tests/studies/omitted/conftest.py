"""The run of which reports of what is left out read something."""

import pytest

from tests.studies.omitted.small_run import build


@pytest.fixture(scope="package")
def run(tmp_path_factory):
    """Its folder and its only object."""
    folder = tmp_path_factory.mktemp("run")
    return folder, build(folder)
