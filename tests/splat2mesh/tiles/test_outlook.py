"""The tiles of a city, without making any of them."""

import json

import numpy as np
import pytest
from cities import TILE_SPLATS, few_pixels, generated

from splat2mesh.base.errors import InputError
from splat2mesh.cli import main
from splat2mesh.options import ConvertOptions, TilingOptions
from splat2mesh.tiles.city import lines_of, outlook
from splat2mesh.tiles.memory import BASE_GB


@pytest.fixture(scope="module")
def source(tmp_path_factory):
    return generated(tmp_path_factory.mktemp("city") / "city")


def test_the_tiles_are_those_that_would_be_made(source, monkeypatch):
    few_pixels(monkeypatch)
    expected = outlook(source, ConvertOptions(detail="draft", up="-y"), TilingOptions(tile_splats=TILE_SPLATS))
    assert expected["tiles"] == len(expected["tile_splats"]) == len(expected["tile_size"]) == 4
    assert sum(expected["tile_splats"]) == pytest.approx(24_000, rel=0.05)
    assert (np.array(expected["tile_size"]) > 0).all()
    assert expected["memory_gb"] > BASE_GB
    assert any("4 of 5," in line for line in lines_of(expected))


def test_the_command_shows_it_and_leaves_nothing(source, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    assert main([str(source), "--memory", "4", "--plan", "--json", "--detail", "draft"]) == 0
    said = json.loads(capsys.readouterr().out)
    assert (said["splats"], said["tiles"]) == (24_000, 1)
    assert said["memory_gb"] < 4
    assert list(tmp_path.iterdir()) == []


def test_a_source_that_cannot_be_planned_is_reported(tmp_path):
    (tmp_path / "a.ply").write_bytes(b"ply\n")
    with pytest.raises(InputError, match=r"a\.ply"):
        outlook(tmp_path)
    with pytest.raises(InputError, match="`eyes`: not supported for a city"):
        outlook(tmp_path, ConvertOptions(eyes=[(0, 0, 0)]))
