"""What objects change in a place, as factors: per splat and per pixel."""

import numpy as np
import OpenEXR
import pytest
import trimesh
from place_splats import wall

from relight import RelightRequest
from relight.cli import main
from relight.jobs.folders import relight_files
from relight.output.catcher_files import BLACK, RATIOS, ratios
from splat2mesh.base.errors import InputError
from splat2mesh.scene.color import linear_from_srgb
from splat2mesh.scene.mesh import Mesh
from splat2mesh.scene.scene import Scene
from splat2mesh.scene.sources import describe
from splat2mesh.splats.formats.inria import write_inria_ply
from splat2mesh.splats.formats.ply import Ply
from splat2mesh.splats.splats import SH_C0, Splats

pytestmark = pytest.mark.filterwarnings("ignore:the light of the capture is unknown")


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    """Folder of results of a disc above a floor of splats of many colours, and the file of the floor."""
    folder = tmp_path_factory.mktemp("catcher")
    splats = wall([-4, 0, -4], [0, 0, 8], [8, 0, 0], 0.1)
    splats.sh[:, 0] = np.random.default_rng(0).uniform(-1.8, 1.6, (len(splats), 3))
    write_inria_ply(folder / "floor.ply", splats)
    across = np.linspace(-4, 4, 41)
    x, z = np.meshgrid(across, across)
    vertices = np.stack([x.ravel(), 0 * x.ravel(), z.ravel()], axis=1).astype(np.float32)
    a = (np.arange(40)[:, None] * 41 + np.arange(40)).ravel()
    faces = np.concatenate([np.stack([a, a + 41, a + 1], 1), np.stack([a + 1, a + 41, a + 42], 1)]).astype(np.int32)
    mesh = Mesh(vertices, np.tile(np.float32([0, 1, 0]), (len(vertices), 1)), faces, np.full_like(vertices, 127, "u1"))
    Scene([mesh], source=describe(folder / "floor.ply")).save(folder / "floor")
    disc = trimesh.creation.box((1.0, 0.02, 1.0))
    (folder / "disc.obj").write_text(trimesh.exchange.obj.export_obj(disc, include_normals=False))
    words = ["--insert", str(folder / "disc.obj"), "--at", "0,.4,0", "--format", "splat", "catcher", "--no-cache"]
    assert main([str(folder / "floor"), *words, "--albedo", "captured", "-o", str(folder / "out"), "-q"]) == 0
    return folder / "out", folder / "floor.ply"


def ratio_of(folder):
    rows = Ply.open(folder / "catcher.ply").rows("vertex")
    return np.stack([rows[name] for name in RATIOS], axis=1)


def light_of(path):
    return linear_from_srgb(np.maximum(Splats.load(path).colors_diffuse, 0.0).astype(np.float64))


def test_captured_colours_times_the_ratio_are_the_relit_ones(made):
    folder, floor = made
    captured, relit, ratio = light_of(floor), light_of(folder / "relit_splat.ply"), ratio_of(folder)
    bright = captured > BLACK
    assert bright.mean() > 0.8 and (ratio < 0.7).any()
    # float32 colours about 1 have steps of 6e-8, and the curve doubles them in light; BLACK and more of them are left.
    np.testing.assert_allclose((captured * ratio)[bright], relit[bright], rtol=1e-5, atol=1e-6)
    assert (ratio[~bright] == 1.0).all()


def test_what_no_object_reaches_is_one_to_the_bit(made):
    folder, floor = made
    same = (Splats.load(floor).sh == Splats.load(folder / "relit_splat.ply").sh).all(axis=(1, 2))
    assert 0.2 < same.mean() < 1.0
    assert (ratio_of(folder)[same] == 1.0).all()


def test_the_colours_of_the_file_are_the_ratio_and_all_else_is_the_sources(made):
    folder, floor = made
    found, source = Splats.load(folder / "catcher.ply"), Splats.load(floor)
    assert found.degree == 0
    np.testing.assert_allclose(0.5 + SH_C0 * found.sh[:, 0], ratio_of(folder), atol=1e-6)
    for name in ("means", "scales", "quats_wxyz", "opacities"):
        np.testing.assert_array_equal(getattr(found, name), getattr(source, name))


def test_the_picture_is_one_where_nothing_changes_and_dark_in_the_shadow(made):
    image = OpenEXR.File(str(made[0] / "catcher.exr")).channels()["RGB"].pixels
    assert image.dtype == np.float32 and image.shape[2] == 3 and np.isfinite(image).all()
    height, width = image.shape[:2]
    assert (image[0] == 1.0).all()  # above the horizon, and beyond the shadow
    assert (image[height // 2 :, width // 3 : 2 * width // 3] < 0.7).any()


def test_black_has_no_ratio():
    def splats(display):
        sh = ((np.array(display, np.float32) - 0.5) / SH_C0)[:, None]
        count = len(sh)
        one = np.ones((count, 3), np.float32)
        return Splats(one, one, np.ones((count, 4), np.float32), np.ones(count, np.float32), sh)

    found = ratios(splats([[0.0, -0.2, 0.5]]), splats([[0.3, 0.3, -0.1]]))
    np.testing.assert_array_equal(found, [[1.0, 1.0, 0.0]])


def test_it_needs_an_object():
    with pytest.raises(InputError, match="`formats` catcher: it holds the change that objects make"):
        RelightRequest("garden", formats=("catcher",))


def test_the_command_says_so_in_one_line(made, capsys):
    assert main([str(made[1].parent / "floor"), "--format", "catcher"]) == 2
    error = capsys.readouterr().err.strip()
    assert "--format catcher" in error and "--insert" in error and len(error.splitlines()) == 1


@pytest.mark.slow
def test_it_comes_from_the_library_too_without_splats_of_its_own(made, tmp_path):
    folder = made[1].parent
    asked = RelightRequest(
        folder / "floor", inserted=[f"{folder / 'disc.obj'} at=0,.4,0"], formats=("catcher",), albedo="captured"
    )
    files = relight_files(RelightRequest.of(asked, output=tmp_path / "out", caching="none")).files
    assert {"catcher.ply", "catcher.exr"} <= {path.name for path in files}
    assert not (tmp_path / "out" / "relit_splat.ply").exists()
    assert (tmp_path / "out" / "catcher.ply").read_bytes() == (made[0] / "catcher.ply").read_bytes()
