"""Splats too small or too far out for 32-bit numbers are refused by a line that names the size."""

import warnings
from dataclasses import replace

import numpy as np
import pytest
from ball_splats import solid_ball

from splat2mesh.base.errors import DataWarning, InputError
from splat2mesh.cli import main
from splat2mesh.splats.extent import check_extent
from splat2mesh.splats.formats import write_inria_ply

BALL = solid_ball(1000)


def ball(scale=1.0, away=0.0):
    means = (BALL.means * scale + np.array([away, 0.0, -away])).astype(np.float32)
    return replace(BALL, means=means, scales=(BALL.scales * scale).astype(np.float32))


@pytest.mark.parametrize(("scale", "away"), [(1e-5, 0.0), (1.0, 3e5), (1e9, 0.0), (1e-3, 100.0), (1e6, 1e12)])
def test_what_32_bits_hold_is_taken_without_a_word(scale, away):
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        check_extent(ball(scale, away))


def test_a_too_small_scene_gets_its_size_and_what_to_do():
    with pytest.raises(InputError, match=r"span 7e-06 units, expected at least 5e-05: scale them up .* by 1e\+05"):
        check_extent(ball(1e-6))


def test_a_scene_rounded_to_rubble_gets_its_distance():
    with pytest.raises(
        InputError, match=r"lie 1e\+07 units from the origin, where positions round to 4.5 of .* offset"
    ):
        check_extent(ball(1.0, 1e7))
    with pytest.warns(DataWarning, match=r"lie 5e\+06 units .* rough"):
        check_extent(ball(1.0, 5e6))


def test_the_command_says_so_before_any_work(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    write_inria_ply("far.ply", ball(1.0, 1e7))
    for more in ([], ["--plan"]):
        assert main(["far.ply", *more]) == 2
        assert "from the origin" in capsys.readouterr().err
    assert [path.name for path in tmp_path.iterdir()] == ["far.ply"]
