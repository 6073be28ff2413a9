"""A scene's proxy: convex parts are convex and hold the mesh, the file is read by others, the command writes it."""

import functools
import io
import subprocess
import sys

import numpy as np
import pytest
import trimesh
from ball_splats import solid_ball
from closed_bodies import inside

from splat2mesh.base.errors import InputError
from splat2mesh.cli import main
from splat2mesh.proxy import add_proxy
from splat2mesh.scene.folder import PROXY
from splat2mesh.scene.mesh import Mesh
from splat2mesh.scene.scene import Scene
from splat2mesh.splats.formats import write_inria_ply
from splat2mesh.surface import wrap
from splat2mesh.surface.wrap import closed_around


@pytest.fixture
def coarse(monkeypatch):
    """Proxies of fewer voxels, and quicker."""
    monkeypatch.setattr(wrap, "closed_around", functools.partial(closed_around, cells=2e4))
    monkeypatch.setattr(wrap, "convex_parts", functools.partial(wrap.convex_parts, cells=2e4))


def corner_scene():
    """An L of two boxes, which no convex part holds alone."""
    low, high = trimesh.creation.box((3, 0.4, 1)), trimesh.creation.box((0.4, 2, 1))
    high.apply_translation([-1.3, 1, 0])
    mesh = trimesh.util.concatenate([low, high]).subdivide()
    colors = np.full((len(mesh.vertices), 3), 128, np.uint8)
    arrays = np.asarray(mesh.vertices, np.float32), np.asarray(mesh.vertex_normals, np.float32)
    return Scene.from_mesh(Mesh(*arrays, np.asarray(mesh.faces, np.int32), colors))


def bodies_of(content):
    return list(trimesh.load(io.BytesIO(content), file_type="glb").geometry.items())


def test_convex_parts_are_convex_and_hold_the_mesh_and_not_its_corner(coarse):
    pytest.importorskip("manifold3d")
    pytest.importorskip("coacd")
    scene = corner_scene()
    add_proxy(scene, "convex")
    parts = [part for _, part in bodies_of(scene.proxy)]
    assert len(parts) == scene.statistics["proxy_bodies"] >= 2
    for part in parts:
        assert part.is_watertight
        outside = (part.vertices[None] - part.triangles[:, :1]) @ part.face_normals[:, :, None]
        assert outside.max() < 1e-4 * part.scale  # no corner stands before any face: float32 over a few units
    held = np.any([inside(part.vertices, part.faces, scene.vertices) for part in parts], axis=0)
    assert held.all()
    assert not any(inside(part.vertices, part.faces, [[1.0, 1.5, 0.0]]) for part in parts)
    first = scene.proxy
    add_proxy(scene, "convex")
    assert scene.proxy == first


def test_the_closed_proxy_is_one_body_that_godot_takes_for_collisions(coarse):
    pytest.importorskip("manifold3d")
    scene = corner_scene()
    add_proxy(scene, "closed")
    ((_, body),) = bodies_of(scene.proxy)
    assert body.is_watertight and inside(body.vertices, body.faces, scene.vertices).all()
    assert b"proxy_000-colonly" in scene.proxy
    assert scene.statistics["proxy_faces"] == len(body.faces)


@pytest.mark.slow
def test_the_command_writes_it_beside_the_mesh(tmp_path, capsys, coarse):
    pytest.importorskip("manifold3d")
    write_inria_ply(tmp_path / "ball.ply", solid_ball())
    out = tmp_path / "ball"
    settings = ["--detail", "draft", "--vertices", "1000", "--proxy", "closed"]
    assert main([str(tmp_path / "ball.ply"), "-o", str(out), *settings]) == 0
    assert "one closed surface of" in capsys.readouterr().out
    ((_, body),) = bodies_of((out / PROXY).read_bytes())
    assert body.is_watertight
    scene = Scene.load(out)  # its checksums allow for the file
    assert inside(body.vertices, body.faces, scene.vertices).all()
    assert scene.settings["proxy"] == "closed"


def test_missing_parts_are_reported_before_any_work(tmp_path):
    write_inria_ply(tmp_path / "ball.ply", solid_ball())
    code = "import sys; sys.modules['manifold3d'] = None; from splat2mesh.cli import main; sys.exit(main(sys.argv[1:]))"
    command = [sys.executable, "-c", code, str(tmp_path / "ball.ply"), "-o", str(tmp_path / "out"), "--proxy", "convex"]
    process = subprocess.run(command, capture_output=True, text=True, timeout=120)
    assert process.returncode == 2
    assert process.stderr.strip().endswith('needs manifold3d, which is not installed: pip install "splat2mesh[proxy]"')
    assert not (tmp_path / "out").exists()


def test_another_kind_is_refused():
    with pytest.raises(InputError, match="`proxy` round: expected one of closed, convex"):
        add_proxy(corner_scene(), "round")
