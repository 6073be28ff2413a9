"""Cameras beside the file that is read, and of splats whose coordinates have an offset."""

import json
from dataclasses import replace

import numpy as np
import pytest
from splat_samples import make_splats

from splat2mesh.base.errors import DataWarning
from splat2mesh.render.view import View
from splat2mesh.splats.facts import FileFacts
from splat2mesh.splats.formats import read_splats, write_splats
from splat2mesh.views.located import located_views

OFFSET = np.array([5e5, 5.4e6, 300.0])


def cameras_json(path, center, count=6):
    entries = []
    for number in range(count):
        angle = 2 * np.pi * number / count
        eye = 6 * np.array([np.cos(angle), 0.2, np.sin(angle)])
        matrix = View.look_at(eye, [0, 0, 0], [0, -1, 0], 50.0, 64).camera_from_world
        place = (eye + center).tolist()
        entry = {"id": number, "img_name": str(number), "width": 64, "height": 64, "fx": 70.0, "fy": 70.0}
        entries.append(entry | {"position": place, "rotation": matrix[:3, :3].T.tolist()})
    path.write_text(json.dumps(entries))
    return path


@pytest.mark.parametrize("center", [OFFSET, np.zeros(3)])
def test_cameras_with_the_offset_and_without_come_to_the_splats(tmp_path, center):
    splats = replace(make_splats(300, 0), facts=FileFacts(offset=tuple(OFFSET.tolist())))
    found = located_views(cameras_json(tmp_path / "cameras.json", center), tmp_path / "a.ply", "auto", splats)
    expected = located_views(
        cameras_json(tmp_path / "plain.json", np.zeros(3)), tmp_path / "a.ply", "auto", make_splats(300, 0)
    )
    assert len(found) == len(expected) == 6
    for view, other in zip(found, expected, strict=True):
        np.testing.assert_allclose(view.camera_from_world, other.camera_from_world, atol=1e-6)


def test_of_the_output_of_the_reference_trainer_the_cameras_are_found(tmp_path):
    for number in (7000, 30000):
        folder = tmp_path / "point_cloud" / f"iteration_{number}"
        folder.mkdir(parents=True)
        write_splats(folder / "point_cloud.ply", make_splats(300, 0))
    cameras_json(tmp_path / "cameras.json", np.zeros(3))
    with pytest.warns(DataWarning, match="once more|newest"):
        splats = read_splats(tmp_path)
    assert len(located_views(None, tmp_path, "auto", splats)) == 6
