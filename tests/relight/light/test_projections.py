"""Light probes: recognised by what is black, resampled so that light keeps its direction and energy."""

import warnings

import numpy as np
import OpenEXR
import pytest

from relight import Environment
from relight.light import projections
from relight.sh import latlong


def _noise(height, width):
    return np.random.default_rng(0).exponential(size=(height, width, 3)).astype(np.float32)


def _smooth(directions):
    """Radiance that names its direction: no two directions and no mirror image share it."""
    x, y, z = np.moveaxis(directions, -1, 0)
    return np.stack([2 + x + 0.3 * y * z, 2 + y + 0.3 * x * z, 2 + z + 0.3 * x * y], axis=-1).astype(np.float32)


def _angular_directions(size):
    """Debevec's definition: at the radius r, 0..1, of the image plane the angle from -z is pi r."""
    offset = (np.arange(size) + 0.5) / size * 2 - 1
    right, up = np.meshgrid(offset, -offset)
    radius = np.hypot(right, up)
    sine = np.sin(np.pi * radius) / radius
    return np.stack([right * sine, up * sine, -np.cos(np.pi * radius)], axis=-1), radius


def _angular_map(size):
    directions, radius = _angular_directions(size)
    return _smooth(directions) * (radius <= 1.0)[..., None]


def _cross(face):
    """Vertical cross by folding: each cell's corner points in space, then straight lines between them."""
    corners = {  # (row, column): upper left, upper right, lower left
        (0, 1): ((-1, 1, 1), (1, 1, 1), (-1, 1, -1)),
        (1, 0): ((-1, 1, 1), (-1, 1, -1), (-1, -1, 1)),
        (1, 1): ((-1, 1, -1), (1, 1, -1), (-1, -1, -1)),
        (1, 2): ((1, 1, -1), (1, 1, 1), (1, -1, -1)),
        (2, 1): ((-1, -1, -1), (1, -1, -1), (-1, -1, 1)),
        (3, 1): ((-1, -1, 1), (1, -1, 1), (-1, 1, 1)),
    }
    image = np.zeros((4 * face, 3 * face, 3), np.float32)
    step = ((np.arange(face) + 0.5) / face)[:, None]
    for (row, column), (origin, across, below) in corners.items():
        origin, across, below = np.array(origin), np.array(across), np.array(below)
        points = origin + step[None] * (across - origin) + step[:, None] * (below - origin)
        points = points / np.linalg.norm(points, axis=-1, keepdims=True)
        image[row * face : (row + 1) * face, column * face : (column + 1) * face] = _smooth(points)
    return image


@pytest.mark.parametrize(("layout", "image"), [("angular map", _angular_map(256)), ("vertical cross", _cross(64))])
def test_light_probes_arrive_from_their_directions(layout, image, tmp_path):
    assert projections.recognise(image) == layout
    path = tmp_path / "probe.exr"
    header = {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage}
    OpenEXR.File(header, {"RGB": image}).write(str(path))
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        light = Environment.load(path)
    height, width = light.radiance.shape[:2]
    assert (height, width) == (128, 256)
    expected = _smooth(projections.texel_directions(height, width))
    # The rim and the edges of faces are held for up to 1.5 texels of 1.4 degrees: 0.037 rad of slope 1.3.
    assert np.abs(light.radiance - expected).max() < 0.05
    assert np.abs(light.radiance - expected).mean() < 0.003


def test_a_logo_in_the_empty_corners_is_ignored():
    probe, cross = _angular_map(256), _cross(64)
    probe[238:252, 190:254] += 1.0
    cross[240:254, 130:190] += 1.0
    assert projections.recognise(probe) == "angular map" and projections.recognise(cross) == "vertical cross"


@pytest.mark.parametrize("shape", [(64, 64), (64, 48), (1, 1), (4, 3), (2, 2)])
def test_pictures_that_fill_their_frame_are_no_probes(shape):
    assert projections.recognise(_noise(*shape)) is None
    assert projections.recognise(np.zeros((*shape, 3), np.float32)) is None


@pytest.mark.parametrize(
    ("convert", "image", "texel"),
    [
        (projections.latlong_from_angular, np.zeros((128, 128, 3), np.float32), (40, 70)),
        (projections.latlong_from_cross, np.zeros((128, 96, 3), np.float32), (45, 52)),
    ],
)
def test_a_sun_of_one_texel_keeps_its_energy_and_direction(convert, image, texel):
    image[texel] = 1000.0
    if image.shape[0] == image.shape[1]:
        directions, radius = _angular_directions(128)
        direction = directions[texel]
        area = (np.pi * 2 / 128) ** 2 * np.sin(np.pi * radius[texel]) / (np.pi * radius[texel])
    else:
        right, down = ((np.array([texel[1], texel[0]]) - 32 + 0.5) / 32) * 2 - 1
        direction = np.array([right, -down, -1.0])
        area = (2 / 32) ** 2 / np.linalg.norm(direction) ** 3
    coefficients = latlong.project_latlong(convert(image), 2)
    # 4 x 4 lookups a texel across a bilinear tent two texels wide.
    assert coefficients[0, 0] * np.sqrt(4 * np.pi) == pytest.approx(1000.0 * area, rel=0.02)
    found = coefficients[[3, 1, 2], 0]
    cosine = found @ direction / np.linalg.norm(found) / np.linalg.norm(direction)
    assert np.degrees(np.arccos(min(cosine, 1.0))) < 0.2  # texels of 2.8 degrees
