"""The small run of the tests of stores."""

from tests.store.conftest import *  # noqa: F403
