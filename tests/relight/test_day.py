"""The sun of a date in requests, and a day from one transfer: a folder for each time, one exposure, a film."""

import json

import numpy as np
import pytest

from relight import LightingOptions, RelightRequest, relight_files
from relight.animation.film import encoder
from relight.light.daylight import DaylightRequest
from splat2mesh.base.errors import InputError
from splat2mesh.base.sphere import row_solid_angles, texel_directions
from splat2mesh.scene.mesh import Mesh
from splat2mesh.scene.scene import Scene

PARIS = {"sun": "2026-06-21T12:00+02:00", "at": "48.85,2.35"}


def floor(tmp_path):
    """A square of ground: its folder."""
    steps = np.linspace(-1.0, 1.0, 9)
    x, z = (grid.ravel() for grid in np.meshgrid(steps, steps))
    vertices = np.stack([x, np.zeros_like(x), z], axis=1).astype(np.float32)
    i = (np.arange(8)[:, None] * 9 + np.arange(8)).ravel()
    faces = np.concatenate([np.stack([i, i + 9, i + 1], 1), np.stack([i + 1, i + 9, i + 10], 1)]).astype(np.int32)
    normals = np.broadcast_to(np.float32([0, 1, 0]), vertices.shape)
    Scene([Mesh(vertices, normals, faces, np.full(vertices.shape, 180, np.uint8))]).save(tmp_path / "floor")
    return tmp_path / "floor"


def test_the_sky_of_a_date_takes_the_place_of_an_environment():
    request = RelightRequest("x", **PARIS, north_deg=20)
    assert request.env == DaylightRequest.parse(PARIS["sun"], PARIS["at"], 20)
    assert request.under("noon").times == []
    assert [time.name for time in RelightRequest("x", **PARIS, day="11:00-13:00/1h").times] == [
        "sun-2026-06-21T1100",
        "sun-2026-06-21T1200",
        "sun-2026-06-21T1300",
    ]


@pytest.mark.parametrize(
    ("wishes", "message"),
    [
        ({"sun": "2026-06-21T12:00", "at": "48,2"}, "zone"),
        ({"sun": PARIS["sun"]}, "`at`"),
        ({"at": "48,2"}, "`sun`"),
        ({"day": "11:00-13:00/1h"}, "`sun`"),
        ({**PARIS, "env": "noon"}, "`env`"),
        ({**PARIS, "at": "91,2"}, "latitude"),
        ({**PARIS, "day": "13:00-11:00/1h"}, "13:00"),
    ],
)
def test_half_a_date_is_said_before_any_work(wishes, message):
    with pytest.raises(InputError, match=message):
        RelightRequest("x", **wishes)


def test_a_day_has_one_exposure_and_gets_dark_in_the_evening(tmp_path):
    """Level ground under the model's own skies: what it sends out is in the ratio of their irradiance."""
    options = LightingOptions("analytic", bands=3)
    request = RelightRequest(
        floor(tmp_path), lighting=options, **PARIS, day="12:00-20:00/8h", albedo="captured", formats=("npy", "png")
    )
    done = relight_files(request)
    assert [folder.name for folder in done.folders] == ["sun-2026-06-21T1200_0", "sun-2026-06-21T2000_0"]
    noon, evening = (json.loads((folder / "report.json").read_text()) for folder in done.folders)
    assert noon["exposure"] == evening["exposure"]
    bright, dim = (float(np.load(folder / "radiance.npy").mean()) for folder in done.folders)

    def level(time):
        """Irradiance of level ground, summed over the map."""
        image = time.environment().radiance.astype(np.float64)
        height, width = image.shape[:2]
        cosine = np.maximum(texel_directions(height, width)[..., 1], 0.0) * row_solid_angles(height, width)
        return float((image.mean(axis=2) * cosine).sum())

    first, second = request.times
    assert dim / bright == pytest.approx(level(second) / level(first), rel=0.1)  # by three bands: a few percent each
    assert (done.film is not None) == (encoder() is not None)
    assert done.film is None or done.film.stat().st_size > 500
