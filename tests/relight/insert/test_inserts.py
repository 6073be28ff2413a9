"""Objects put into a scene, from a request to files."""

import json

import numpy as np
import pygltflib
import pytest
import trimesh
from gltf_check import validator_issues
from insert_places import card, disc, floor_place, grid_floor, obj, request, rows
from textured_quads import packed, textured, write_square

from relight import RelightRequest
from relight.cli import main
from relight.insert.asked import AskedInsert
from relight.insert.standing import placed_by
from relight.jobs.folders import relight_files
from relight.jobs.job import Job
from relight.transfer.occluder import Occluder
from splat2mesh.base.errors import DataWarning, InputError
from splat2mesh.scene.mesh import Mesh
from splat2mesh.scene.scene import Scene
from splat2mesh.splats.splats import SH_C0, Splats

UPSIDE_DOWN = np.diag([1.0, -1.0, -1.0, 1.0])
pytestmark = pytest.mark.filterwarnings("ignore:the light of the capture is unknown")


@pytest.fixture
def place(tmp_path):
    return floor_place(tmp_path)


def test_a_black_disc_darkens_the_splats_below_it_by_its_form_factor(place, tmp_path):
    asked = f"{disc(tmp_path)} at=0,.5,0 albedo=0"
    relight_files(request(place, [asked], tmp_path / "out"))
    splats = Splats.load(tmp_path / "out" / "relit_splat.ply")
    shown = 0.5 + SH_C0 * splats.sh[:, 0]
    distance = np.linalg.norm(splats.means[:, [0, 2]], axis=1)
    z = 1 + (0.495**2 - 0.25) / np.maximum(distance, 1e-9) ** 2
    both = (1 + (0.495**2 + 0.25) / np.maximum(distance, 1e-9) ** 2) ** 2 - 4 * 0.25 / np.maximum(distance, 1e-9) ** 2
    factor = 0.5 * (1 - z / np.sqrt(both))
    ratio = (1.05 - factor) / 1.05  # a twentieth of the light is added to both
    wanted = (0.5 + 0.055) * ratio ** (1 / 2.4) - 0.055
    judged = (distance > 0.02) & (distance < 1.5)
    # Of the disc's albedo of .02 and of the change that is left out: a hundredth.
    np.testing.assert_allclose(shown[judged].mean(axis=1), wanted[judged], atol=0.02)


@pytest.mark.slow
def test_what_is_not_reached_keeps_every_bit_and_nothing_put_in_changes_nothing(place, tmp_path):
    source = rows(tmp_path / "floor.ply")
    relight_files(request(place, [f"{disc(tmp_path, 0.2)} at=-2,.3,-2"], tmp_path / "with"))
    changed = (rows(tmp_path / "with" / "relit_splat.ply") != source).any(axis=1)
    apart = np.linalg.norm(source.view("<f4")[:, [0, 2]] + 2, axis=1)
    assert changed[apart < 0.2].all()
    assert not changed[apart > 2.0].any()
    relight_files(RelightRequest(place, "captured", albedo="captured", output=tmp_path / "no", formats=("splat",)))
    np.testing.assert_array_equal(rows(tmp_path / "no" / "relit_splat.ply"), source)


def test_a_white_wall_throws_light_on_the_floor_in_its_new_light(place, tmp_path):
    """Under a light from one side alone, what faces a wall that it lights is brighter than without."""
    sunny = np.full((32, 64, 3), 1e-3, np.float32)
    sunny[10, 16] = 300.0  # from +x, 33 degrees above the horizon
    from relight.light.environment import Environment

    light = Environment(sunny, "low")
    slab = obj(tmp_path / "wall.obj", trimesh.creation.box((0.05, 1.0, 2.0)))
    job = Job(request(place, [f"{slab} at=-1,.5,0 albedo=.9"], None, env=light))
    shaded = next(job.shaded())
    before = Job(RelightRequest(place, light, albedo="captured", formats=("splat",)))
    ratio = shaded.shading.radiance / next(before.shaded()).shading.radiance
    x, _, z = job.known.scene.vertices.T
    lit, shade = (x > -0.9) & (x < -0.5) & (abs(z) < 0.3), (x < -1.2) & (x > -1.8) & (abs(z) < 0.3)
    assert (ratio[lit] > 1.05).all()
    assert (ratio[shade] < 0.2).all()


@pytest.mark.slow
def test_a_mesh_keeps_material_and_picture_and_validates(place, tmp_path):
    from PIL import Image

    ball = trimesh.creation.icosphere(2, radius=0.3)
    image = Image.fromarray(np.full((4, 4, 3), (255, 0, 0), np.uint8))
    material = trimesh.visual.material.PBRMaterial(baseColorTexture=image, alphaMode="MASK", alphaCutoff=0.25)
    uv = np.random.default_rng(0).random((len(ball.vertices), 2))
    ball.visual = trimesh.visual.TextureVisuals(uv, material=material)
    (tmp_path / "ball.glb").write_bytes(trimesh.Scene(ball).export(file_type="glb"))
    done = relight_files(request(place, [f"{tmp_path / 'ball.glb'} at=0,.3,0"], tmp_path / "out"))
    assert {"inserted.glb", "inserted.png"} <= set(done.reports[0]["files"])
    assert done.reports[0]["inserted"][0]["at"] == [0.0, 0.3, 0.0]
    file = pygltflib.GLTF2().load(tmp_path / "out" / "inserted.glb")
    made = file.materials[0]
    assert (made.alphaMode, made.alphaCutoff) == ("MASK", 0.25)
    assert "KHR_materials_unlit" in made.extensions and made.pbrMetallicRoughness.baseColorTexture is not None
    mesh = trimesh.load(tmp_path / "out" / "inserted.glb", force="mesh")
    np.testing.assert_allclose(mesh.bounds, [[-0.3, 0.0, -0.3], [0.3, 0.6, 0.3]], atol=2e-3)
    assert validator_issues(tmp_path / "out" / "inserted.glb")["messages"] == []


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["webp", "mask", "ktx2"])
def test_pictures_of_other_kinds_are_written_as_every_program_reads_them(place, tmp_path, kind):
    pixels = np.dstack([np.full((8, 8, 3), (255, 128, 0), np.uint8), np.full((8, 8), 255, np.uint8)])
    textures, content = [{"source": 0}], packed(pixels)
    if kind == "webp":
        textures, content = [{"extensions": {"EXT_texture_webp": {"source": 0}}}], packed(pixels, "WEBP")
    elif kind == "ktx2":
        textures, content = [{"extensions": {"KHR_texture_basisu": {"source": 0}}}], b"\xabKTX 20\xbb\r\n\x1a\n"
    else:
        pixels[:, 4:, 3] = 0
        content = packed(pixels)
    copies = {"TRANSLATION": np.array([[-0.5, 0.2, -0.5], [1.0, 0.2, -0.5]])}
    path = write_square(tmp_path / "a.glb", textured(alphaMode="MASK"), [content], textures, copies)
    asked = request(place, [f"{path} at=0,.2,0"], tmp_path / "out")
    if kind == "ktx2":
        with pytest.warns(DataWarning, match=r"1 textures cannot be decoded \(KHR_texture_basisu\)"):
            relight_files(asked)
    else:
        relight_files(asked)
    made = pygltflib.GLTF2().load(tmp_path / "out" / "inserted.glb")
    assert len(made.meshes) == 2 and [image.mimeType for image in made.images] == ["image/png"] * (kind != "ktx2")
    assert validator_issues(tmp_path / "out" / "inserted.glb")["messages"] == []
    bounds = trimesh.load(tmp_path / "out" / "inserted.glb", force="mesh").bounds
    # To the half of the second square that the mask leaves, and the eighth of a texel by which it is rounded.
    assert bounds[1, 0] - bounds[0, 0] == pytest.approx(2.0 if kind == "mask" else 2.5, abs=0.02)


@pytest.mark.slow
def test_a_splat_takes_the_light_of_the_place_and_stands_behind_its_rows(place, tmp_path):
    folder, own = card(tmp_path)
    with pytest.warns(DataWarning, match="could not be separated"):
        relight_files(request(place, [f"{folder} at=1,.2,0 turn=90 scale=2"], tmp_path / "out"))
    found = Splats.load(tmp_path / "out" / "relit_splat.ply")
    count = len(Splats.load(tmp_path / "floor.ply"))
    assert len(found) == count + len(own)
    x, y, z = own.means.T
    moved = np.stack([1 + 2 * z, 0.2 + 2 * y, -2 * x], axis=1)
    np.testing.assert_allclose(found.means[count:], moved, atol=1e-5)
    np.testing.assert_allclose(found.scales[count:], 2 * own.scales, rtol=1e-5)
    assert not (tmp_path / "out" / "inserted.glb").exists()


@pytest.mark.parametrize("matrix", [np.eye(4), UPSIDE_DOWN], ids=["upright", "upside down"])
def test_an_object_stands_upright_on_the_floor_whichever_way_the_splat_is_turned(matrix):
    floor = grid_floor()
    scene = Scene([floor], scene_from_splat=matrix)
    occluder = Occluder(floor.vertices, floor.normals, floor.faces)
    box = trimesh.creation.box((0.2, 0.6, 0.4)).vertices.astype(np.float32)
    at = np.linalg.inv(matrix) @ [1.0, 2.0, -1.0, 1.0]
    placed = placed_by(AskedInsert("box.obj", tuple(at[:3]), 90.0, 0.5, "floor"), box, scene, occluder)
    corners = box @ placed[:3, :3].T + placed[:3, 3]
    np.testing.assert_allclose(corners.min(axis=0), [0.9, 0.0, -1.05], atol=1e-4)
    np.testing.assert_allclose(corners.max(axis=0), [1.1, 0.3, -0.95], atol=1e-4)


def test_what_has_another_unit_is_scaled_and_that_is_said():
    floor = grid_floor()
    scene, occluder = Scene([floor]), Occluder(floor.vertices, floor.normals, floor.faces)
    box = (1800 * trimesh.creation.box().vertices).astype(np.float32)  # millimetres
    with pytest.warns(DataWarning, match="its unit is assumed to differ"):
        placed = placed_by(AskedInsert("box.obj"), box, scene, occluder)
    np.testing.assert_allclose(placed[0, 0], 0.001)
    with pytest.warns(DataWarning, match="too small"):
        placed_by(AskedInsert("box.obj", scale=1e-8), box, scene, occluder)


def test_an_object_below_the_ground_is_reported(place, tmp_path):
    ball = obj(tmp_path / "ball.obj", trimesh.creation.icosphere(1, radius=0.1))
    shell = trimesh.creation.icosphere(2, radius=0.2)
    around = (shell.vertices - [0, 0.25, 0]).astype(np.float32)
    white = np.full(shell.vertices.shape, 255, np.uint8)
    below = Scene([grid_floor(), Mesh(around, shell.vertices.astype(np.float32), np.int32(shell.faces), white)])
    with pytest.warns(DataWarning, match="is in the dark"):
        next(Job(RelightRequest(below, inserted=[f"{ball} at=0,-.25,0"], albedo="captured", formats=("npy",))).shaded())


@pytest.mark.parametrize("content", ["", "v 0 0 0\n", "v 0 0 0\nf 1 2 3\n"])
def test_broken_files_end_with_one_line_and_exit_code_2(place, tmp_path, content, capsys):
    (tmp_path / "broken.obj").write_text(content)
    words = ["--insert", str(tmp_path / "broken.obj"), "--at", "0,0,0", "-o", str(tmp_path / "out")]
    assert main([str(place), "--albedo", "captured", *words]) == 2
    assert len(capsys.readouterr().err.strip().splitlines()) == 1


@pytest.mark.slow
def test_the_same_objects_add_to_a_folder_and_others_are_refused(place, tmp_path):
    asked = f"{disc(tmp_path)} at=0,.5,0"
    relight_files(request(place, [asked], tmp_path / "out"))
    relight_files(request(place, [asked], tmp_path / "out"))
    with pytest.raises(InputError, match="inserted"):
        relight_files(request(place, [asked.replace(".5", ".6")], tmp_path / "out"))
    assert json.loads((tmp_path / "out" / "report.json").read_text())["inserted"][0]["name"] == "disc.obj"
