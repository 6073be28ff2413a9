"""Alpha masks become triangles: their area is that of the mask, and nothing else casts a shadow."""

import numpy as np
import pytest
from textured_quads import CORNERS, FOUR, packed, textured, write_square

from relight.insert.asked import asked_inserts
from relight.insert.objects import read_object
from relight.insert.refine import Masked, carried, cut_out
from splat2mesh.base.errors import InputError
from splat2mesh.render.raycaster import RayCaster
from splat2mesh.scene.color import linear_from_srgb
from splat2mesh.scene.gltftextures import MappedTexture

CLAMPED = 33071
SQUARE = np.array([[0, 2, 1], [0, 3, 2]])


def mask(alpha, color=(200, 100, 50)):
    """(H, W, 4) uint8: a colour where there is a surface, black elsewhere."""
    alpha = np.asarray(alpha)
    pixels = np.zeros((*alpha.shape, 4), np.uint8)
    pixels[..., 3] = np.rint(255 * alpha)
    pixels[alpha > 0, :3] = color
    return pixels


def disc(side, radius=0.35):
    across = (np.arange(side) + 0.5) / side - 0.5
    return (np.hypot(*np.meshgrid(across, across)) < radius).astype(float)


def areas(points, faces):
    a, b, c = (points[faces[:, corner]].astype(float) for corner in range(3))
    return 0.5 * np.linalg.norm(np.cross(b - a, c - a), axis=1)


def cut(pixels, cutoff=0.5, opacity=(1.0,) * 4, most=100_000):
    texture = MappedTexture(pixels, CORNERS[:, ::2].astype(float), (CLAMPED, CLAMPED))
    surface = Masked(CORNERS.astype(float), texture.uv, np.float32(opacity), texture, cutoff)
    faces, rounds, found = cut_out(surface, SQUARE, most)
    return found.of(carried(surface.points, rounds)), faces


@pytest.mark.parametrize("side", [8, 64, 200])
def test_the_area_that_remains_is_that_of_the_mask(side):
    pixels = mask(disc(side))
    points, faces = cut(pixels)
    # Cut between texels: at each corner of the staircase an eighth of a texel is cut off or filled in.
    wanted, edges = (pixels[..., 3] > 0).mean(), 8 * 0.35 * side
    assert abs(areas(points, faces).sum() - wanted) <= edges / 8 / side**2
    assert (areas(points, faces) > 0.0).mean() > 0.95
    assert np.unique(faces).tolist() == list(range(len(points)))


def test_no_triangle_covers_what_is_cut_and_all_look_the_same_way():
    points, faces = cut(mask(disc(64)))
    middles = points[faces].mean(axis=1)[:, ::2]
    assert np.hypot(*(middles - 0.5).T).max() < 0.35 + np.sqrt(2) / 64
    a, b, c = (points[faces[:, corner]] for corner in range(3))
    assert (np.cross(b - a, c - a)[:, 1] >= 0.0).all()


def test_an_opaque_picture_changes_nothing_and_a_clear_one_leaves_nothing():
    points, faces = cut(mask(np.ones((16, 16))))
    np.testing.assert_array_equal(points[faces], CORNERS[SQUARE])
    assert len(cut(mask(np.zeros((16, 16))))[1]) == 0


def test_the_cutoff_and_the_opacity_of_vertices_move_the_edge():
    ramp = np.tile((np.arange(64) + 0.5) / 64, (64, 1))
    for cutoff in (0.25, 0.5, 0.75):
        points, faces = cut(mask(ramp), cutoff)
        assert points[faces][..., 0].min() == pytest.approx(cutoff, abs=1 / 255)
        assert areas(points, faces).sum() == pytest.approx(1.0 - cutoff, abs=1 / 255)
    # Alpha that falls from 1 to 0 along z, under an opaque picture.
    points, faces = cut(mask(np.ones((16, 16))), 0.25, opacity=(1.0, 1.0, 0.0, 0.0))
    assert points[faces][..., 2].max() == pytest.approx(0.75, abs=1e-6)


def test_where_there_are_too_many_faces_those_that_are_mostly_there_stay_whole():
    points, faces = cut(mask(disc(64)), most=0)
    assert areas(points, faces).sum() in (0.0, 0.5, 1.0)


def test_an_object_is_cut_and_keeps_its_colour_up_to_its_edge(tmp_path):
    pixels = mask(disc(64))
    path = write_square(tmp_path / "a.glb", textured(alphaMode="MASK"), [packed(pixels)], [{"source": 0}])
    (part,) = read_object(asked_inserts([f"{path} at=0,0,0"])[0]).parts
    assert areas(part.vertices, part.faces).sum() == pytest.approx((pixels[..., 3] > 0).mean(), abs=0.003)
    color = linear_from_srgb(np.array([200, 100, 50]) / np.float32(255.0))
    np.testing.assert_allclose(part.albedo, np.tile(color, (len(part.vertices), 1)), rtol=1e-6)
    # What follows the vertices of the file, such as a pose, comes out at those of the part.
    np.testing.assert_allclose(part.carried(CORNERS), part.vertices, atol=1e-6)


def test_rays_pass_where_the_mask_is_clear_and_nowhere_else(tmp_path):
    pixels = mask(1.0 - disc(64))  # a square with a round hole
    path = write_square(tmp_path / "a.glb", textured(alphaMode="MASK"), [packed(pixels)], [{"source": 0}])
    found = read_object(asked_inserts([f"{path} at=0,0,0"])[0])
    across = (np.arange(100) + 0.5) / 100
    x, z = (each.ravel() for each in np.meshgrid(across, across))
    rays = np.zeros((len(x), 6), np.float32)
    rays[:, 0], rays[:, 1], rays[:, 2], rays[:, 4] = x, 1.0, z, -1.0
    hit = np.isfinite(RayCaster(found.joined("vertices"), found.faces).first_hits(rays).distance)
    away = np.hypot(x - 0.5, z - 0.5)
    clear = np.abs(away - 0.35) > np.sqrt(2) / 64  # a texel from the edge
    np.testing.assert_array_equal(hit[clear], away[clear] > 0.35)


@pytest.mark.parametrize(("factor", "left"), [(0.6, 1.0), (0.4, 0.0)])
def test_a_mask_of_a_factor_alone(tmp_path, factor, left):
    material = {"alphaMode": "MASK", "pbrMetallicRoughness": {"baseColorFactor": [1, 1, 1, factor]}}
    path = write_square(tmp_path / "a.glb", material)
    if not left:
        with pytest.raises(InputError, match="masks leave nothing of it"):
            read_object(asked_inserts([f"{path} at=0,0,0"])[0])
        return
    (part,) = read_object(asked_inserts([f"{path} at=0,0,0"])[0]).parts
    assert areas(part.vertices, part.faces).sum() == pytest.approx(left)


@pytest.mark.parametrize("kind", ["webp", "specular", "transform", "glow"])
def test_an_object_takes_the_colours_of_its_texture(tmp_path, kind):
    expected = linear_from_srgb(FOUR / np.float32(255.0)).mean(axis=(0, 1))
    textures, material, pictures = [{"source": 0}], textured(), [packed(FOUR)]
    if kind == "webp":
        textures, pictures = [{"extensions": {"EXT_texture_webp": {"source": 0}}}], [packed(FOUR, "WEBP")]
    elif kind == "specular":
        own = {"diffuseTexture": {"index": 0}, "specularFactor": [0.04] * 3}
        material = {"extensions": {"KHR_materials_pbrSpecularGlossiness": own}}
    elif kind == "transform":  # the upper left quarter alone
        material = textured({"extensions": {"KHR_texture_transform": {"scale": [0.49, 0.49]}}})
        expected = np.array([1.0, 0.0, 0.0])
    elif kind == "glow":
        material = {"emissiveFactor": [1, 1, 1], "emissiveTexture": {"index": 0}}
    path = write_square(tmp_path / "a.glb", material, pictures, textures)
    (part,) = read_object(asked_inserts([f"{path} at=0,0,0"])[0]).parts
    found = part.emission if kind == "glow" else part.albedo
    # Vertices on the lines between texels and at the borders count for one of them.
    np.testing.assert_allclose(found.mean(axis=0), np.clip(expected, 0.02, 0.95), atol=0.04)


def test_copies_are_parts(tmp_path):
    copies = {"TRANSLATION": np.array([[0, 0, 0], [3, 0, 0], [6, 0, 0.0]])}
    path = write_square(tmp_path / "a.glb", {}, copies=copies)
    found = read_object(asked_inserts([f"{path} at=0,0,0"])[0])
    assert [part.vertices[:, 0].min() for part in found.parts] == [0.0, 3.0, 6.0]
