import os
import pathlib

import pytest


@pytest.fixture(scope="session")
def repository() -> pathlib.Path:
    """The checkout that these tests lie in."""
    return pathlib.Path(os.environ.get("CALE_SOURCE_DIR", pathlib.Path(__file__).parents[2]))
