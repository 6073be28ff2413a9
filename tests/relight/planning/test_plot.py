"""The picture of a plan: drawn from its curve, and refused where there is none."""

import imageio.v3 as iio
import numpy as np
import pytest

from relight.cli import main
from relight.planning.plan import CHOICE


@pytest.fixture
def mesh(tmp_path):
    import open3d as o3d

    path = tmp_path / "ball.ply"
    ball = o3d.geometry.TriangleMesh.create_sphere(0.5, 24)
    ball.compute_vertex_normals()
    o3d.io.write_triangle_mesh(str(path), ball + ball.translate((0.7, 0.0, 0.0), relative=False))
    return path


def test_the_curve_of_a_plan_is_drawn_with_its_choice(mesh, tmp_path, capsys):
    path = tmp_path / "cost.png"
    assert main([str(mesh), "--plan", "--env", "noon", "--plot", str(path)]) == 0
    assert f"{path}: what accuracy costs here" in capsys.readouterr().out
    image = iio.imread(path)[..., :3].astype(int)
    wanted = np.array([int(CHOICE[at : at + 2], 16) for at in (1, 3, 5)])
    assert (np.abs(image - wanted).sum(axis=-1) < 10).sum() > 50  # its point and the tolerance's line


@pytest.mark.parametrize("more", [["--plot", "cost.png"], ["--plan", "--plot", "cost.exr"]])
def test_a_plot_without_a_plan_and_one_of_another_kind_are_refused(mesh, more, capsys):
    assert main([str(mesh), *more]) == 2
    assert "--plot cost" in capsys.readouterr().err


def test_a_plot_that_cannot_be_written_is_refused_before_anything_is_planned(mesh, capsys):
    assert main([str(mesh), "--plan", "--env", "noon", "--plot", str(mesh / "cost.png")]) == 2
    assert "cannot write to" in capsys.readouterr().err
