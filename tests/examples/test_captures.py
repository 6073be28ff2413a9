"""The example captures: small, readable, of degree 0, without a splat that nobody can draw."""

from pathlib import Path

import pytest

from splat2mesh.splats.cleaning import usable
from splat2mesh.splats.formats import kind_of, read_splats

EXAMPLES = Path(__file__).resolve().parents[2] / "examples"


@pytest.mark.parametrize(("name", "splats"), [("garden", 310_795), ("lounge", 214_289)])
def test_an_example_is_a_small_sog_of_splats_that_can_all_be_drawn(name, splats):
    path = EXAMPLES / f"{name}.sog"
    assert path.stat().st_size < 8e6 and kind_of(path) == "sog"
    found = read_splats(path)
    assert len(found) == splats and found.degree == 0 and usable(found)[0].all()
