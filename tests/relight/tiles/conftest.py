"""One small city for all tests of its light: each lights it into a folder of its own."""

import pytest
from cities import few_pixels, generated, meshed


@pytest.fixture(scope="session")
def city(tmp_path_factory):
    """The folder of a meshed city of four tiles."""
    folder = tmp_path_factory.mktemp("city")
    with pytest.MonkeyPatch.context() as patch:
        few_pixels(patch)
        meshed(generated(folder / "city"), folder / "scene")
    return folder / "scene"
