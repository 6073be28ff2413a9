"""The whole way from a splat file to a scene: near the truth, reproducible, and honest about what it did."""

from dataclasses import asdict

import numpy as np
import open3d as o3d
import pytest
from disc_splats import plain
from generated import UP, scene, seen_points
from scipy.spatial import cKDTree

from scenes import capture_views
from scenes.cameras import FLIP, write_colmap
from splat2mesh import convert
from splat2mesh.api import plan_mesh as plan
from splat2mesh.base.errors import DataWarning, InputError
from splat2mesh.base.progress import Stages
from splat2mesh.render.view import View
from splat2mesh.scene.scene import Scene
from splat2mesh.scene.sources import describe
from splat2mesh.splats.formats import write_inria_ply
from splat2mesh.surface.album import RenderedPicture
from splat2mesh.surface.extract import EFFORTS, Effort
from splat2mesh.views.upright import UP_CHOICES

VERTICES, LIMIT = 6000, 1500
SMALL = 5000
"""Splats of the object, for what does not depend on accuracy."""


@pytest.fixture(scope="module")
def files(tmp_path_factory):
    """A splat file of each kind, and a COLMAP model of the object's capture in `sparse`."""
    folder = tmp_path_factory.mktemp("splats")
    write_inria_ply(folder / "object.ply", scene("object")[2])
    write_inria_ply(folder / "small.ply", scene("object", SMALL)[2])
    write_inria_ply(folder / "tabletop.ply", scene("tabletop", 30_000)[2])
    write_colmap(folder / "sparse", capture_views(scene("object")[0], 48, 256))
    return folder


@pytest.fixture(scope="module")
def stages():
    """Of `converted`."""
    return Stages()


@pytest.fixture(scope="module")
def converted(files, stages):
    return convert(files / "object.ply", detail="draft", vertices=VERTICES, max_chunk_vertices=LIMIT, stages=stages)


@pytest.fixture
def quick(monkeypatch):
    """A detail below draft, for what does not depend on accuracy."""
    monkeypatch.setitem(EFFORTS, "draft", Effort(views=12, pixels=96, cells=80))


def f_score(found, truth, seen, share):
    """Harmonic mean of precision (found points near the truth) and recall (truth that the capture saw, found again).

    share: the distance that counts as near, as a share of the true diagonal. Source: Knapitsch et al. 2017.
    """
    rng = np.random.default_rng(0)
    a, b, c = (found.vertices[found.faces[:, corner]].astype(float) for corner in range(3))
    area = np.linalg.norm(np.cross(b - a, c - a), axis=1)
    face = rng.choice(len(area), 40_000, p=area / area.sum())
    u, v = rng.random((2, len(face), 1))
    u, v = np.where(u + v > 1, 1 - u, u), np.where(u + v > 1, 1 - v, v)
    points = a[face] + u * (b[face] - a[face]) + v * (c[face] - a[face])
    visible, _ = seen_points(truth, seen, 40_000)
    everything, _ = seen_points(truth, np.ones_like(seen), 80_000)
    near = share * np.linalg.norm(np.ptp(truth.vertices, axis=0))
    # Samples of two equal surfaces are not equal: with 80,000 they are 0.002 of the diagonal apart at the most.
    precision = (cKDTree(everything).query(points, workers=-1)[0] < near).mean()
    recall = (cKDTree(points).query(visible, workers=-1)[0] < near).mean()
    return 2 * precision * recall / (precision + recall)


def contents(scene_found):
    parts = [getattr(chunk, name) for chunk in scene_found.chunks for name in ("vertices", "normals", "faces")]
    return [part.tobytes() for part in parts] + [chunk.colors_srgb.tobytes() for chunk in scene_found.chunks]


def test_an_object_is_near_the_truth_whole_and_coloured(converted):
    truth, seen, _ = scene("object")
    assert f_score(converted, truth, seen, 0.01) > 0.995
    assert f_score(converted, truth, seen, 0.005) > 0.95
    a, b, c = (converted.vertices[converted.faces[:, corner]].astype(float) for corner in range(3))
    volume = np.einsum("ij,ij->", a, np.cross(b, c)) / 6
    a, b, c = (truth.vertices[truth.faces[:, corner]].astype(float) for corner in range(3))
    # Positive, so faces look outwards; a surface half a percent of the diagonal too small is 5% less.
    assert volume == pytest.approx(np.einsum("ij,ij->", a, np.cross(b, c)) / 6, rel=0.05)
    truth_colors = np.clip(0.5 + 0.28209479 * scene("object")[2].sh[:, 0], 0, 1)
    means = scene("object")[2].means * FLIP
    error = np.abs(converted.colors_srgb / 255 - truth_colors[cKDTree(means).query(converted.vertices)[1]])
    # The nearest splat need not be the one that shows; patches of colour have borders.
    assert np.median(error) < 0.03


@pytest.mark.slow
def test_a_tabletop_is_near_the_truth_where_it_was_seen(files):
    truth, seen, _ = scene("tabletop", 30_000)
    found = convert(files / "tabletop.ply", detail="draft", vertices=20_000)
    # Undersides and gaps between solids that no virtual view reaches are missing, and 30,000 splats are few.
    assert f_score(found, truth, seen, 0.01) > 0.93
    assert f_score(found, truth, seen, 0.005) > 0.84


def test_what_was_done_is_recorded(converted, files):
    reason = converted.settings["up_from"]
    assert reason == "assumed -y, since no plane stands out as a floor"
    assert converted.settings == {
        "detail": "draft",
        "surface": "field",
        "background": "cut",
        "vertices": VERTICES,
        "max_chunk_vertices": LIMIT,
        "up": "auto",
        "up_from": reason,
        "lod": "auto",
        "from": "auto",
        "seed": 0,
        "cameras": "virtual",
    }
    statistics = converted.statistics
    assert statistics["splats"] == 20_000 and statistics["splats_non_finite"] == 0
    assert statistics["splats_background"] == 0
    assert 0.7 * EFFORTS["draft"].views <= statistics["views"] <= 1.25 * EFFORTS["draft"].views
    assert statistics["faces"] == sum(len(chunk.faces) for chunk in converted.chunks)
    assert 0.8 * VERTICES < statistics["vertices"] <= 1.05 * VERTICES
    assert 0 <= statistics["vertices_unseen"] < 0.05 * statistics["vertices"]
    assert converted.source == describe(files / "object.ply")


def test_chunks_keep_their_limit_and_lose_nothing(converted, files, quick):
    assert len(converted.chunks) >= 4 and max(len(chunk.vertices) for chunk in converted.chunks) <= LIMIT
    settings = {"detail": "draft", "vertices": 1500, "stand": "outside"}
    whole = convert(files / "small.ply", max_chunk_vertices=10**6, **settings)
    parts = convert(files / "small.ply", max_chunk_vertices=300, **settings)
    assert len(whole.chunks) == 1

    def corners(found):
        triangles = found.vertices[found.faces].reshape(-1, 9)
        return triangles[np.lexsort(triangles.T)].tobytes()

    assert corners(parts) == corners(whole)


def test_the_preview_camera_looks_at_the_scene_from_slightly_above(converted, tmp_path):
    camera = converted.preview_camera
    eye, target = np.array(camera["eye"]), np.array(camera["target"])
    low, high = converted.bounds
    assert camera["up"] == [0.0, 1.0, 0.0] and 20 < camera["fov_deg"] < 90
    assert eye[1] > target[1] and ((low < target) & (target < high)).all()
    # The whole scene lies in a cone of the field of view.
    towards = (target - eye) / np.linalg.norm(target - eye)
    rays = converted.vertices - eye
    angle = np.degrees(np.arccos(rays @ towards / np.linalg.norm(rays, axis=1)))
    assert angle.max() < camera["fov_deg"] / 2
    converted.save(tmp_path / "scene")
    assert Scene.load(tmp_path / "scene").preview_camera == camera


def test_the_same_file_gives_the_same_bytes_on_any_number_of_threads(files, quick, monkeypatch):
    results = []
    for threads in (1, 3):
        monkeypatch.setattr("splat2mesh.base.threads.all_cores", lambda threads=threads: threads)
        found = convert(files / "small.ply", detail="draft", vertices=1500, max_chunk_vertices=500)
        results.append((contents(found), found.statistics, found.preview_camera))
    assert results[0] == results[1]
    other = convert(files / "small.ply", detail="draft", vertices=1500, max_chunk_vertices=500, seed=1)
    assert contents(other) != results[0][0]


@pytest.mark.slow
def test_up_is_up_whatever_it_was_in_the_file(files, quick):
    axes = {"auto": UP, "+y": [0, 1, 0], "-y": [0, -1, 0], "+z": [0, 0, 1], "-z": [0, 0, -1]}
    boxes = []
    for up in UP_CHOICES:
        found = convert(files / "small.ply", detail="draft", vertices=1500, up=up, stand="outside")
        turn = found.scene_from_splat[:3, :3]
        np.testing.assert_array_equal(turn @ axes[up], [0, 1, 0])
        assert np.linalg.det(turn) == 1 and found.settings["up"] == up
        inside = found.vertices @ turn  # back in the frame of the file
        boxes.append([inside.min(axis=0), inside.max(axis=0)])
    # The same object in the file's frame, whichever way the views were turned: to half a voxel.
    voxel = np.linalg.norm(np.ptp(boxes[0], axis=0)) / EFFORTS["draft"].cells
    np.testing.assert_allclose(boxes, np.broadcast_to(boxes[0], np.shape(boxes)), atol=voxel)


def test_broken_rows_are_as_if_they_were_not_there(files, tmp_path, quick):
    content = (files / "small.ply").read_bytes()
    start = content.index(b"end_header\n") + len(b"end_header\n")
    rows = np.frombuffer(content[start:], "<f4").reshape(SMALL, -1).copy()
    broken, columns = np.random.default_rng(0).choice(SMALL, 51, replace=False), np.arange(51) % rows.shape[1]
    rows[broken, columns] = np.nan
    # Normals, three of the 17 columns, are not read: a NaN there breaks nothing.
    harmful = broken[~np.isin(columns, [3, 4, 5])]
    header = content[:start].replace(b"vertex %d\n" % SMALL, b"vertex %d\n" % (SMALL - len(harmful)))
    (tmp_path / "broken.ply").write_bytes(content[:start] + rows.tobytes())
    (tmp_path / "without.ply").write_bytes(header + np.delete(rows, harmful, axis=0).tobytes())
    (tmp_path / "naive.ply").write_bytes(content[:start] + np.nan_to_num(rows).tobytes())
    with pytest.warns(DataWarning, match=rf"dropped splats: {len(harmful)} with a NaN .* \(of {SMALL}\)"):
        found = convert(tmp_path / "broken.ply", detail="draft", vertices=1500)
    assert found.statistics["splats_non_finite"] == len(harmful) and found.statistics["splats"] == SMALL
    without, naive = (convert(tmp_path / f"{name}.ply", detail="draft", vertices=1500) for name in ("without", "naive"))
    assert contents(found) == contents(without)
    assert contents(found) != contents(naive)  # rows of zeros in place of what is broken do harm


@pytest.mark.slow
def test_trained_cameras_are_used_and_do_as_well_as_virtual_ones(files, converted):
    truth, seen, _ = scene("object")
    found = convert(files / "object.ply", cameras=files / "sparse", detail="draft", vertices=VERTICES)
    assert found.settings["cameras"] == "trained" and found.statistics["views"] == EFFORTS["draft"].views
    # Level cameras determine which way is up.
    np.testing.assert_allclose(found.scene_from_splat[:3, :3] @ UP, [0, 1, 0], atol=1e-3)
    assert f_score(found, truth, seen, 0.005) > f_score(converted, truth, seen, 0.005) - 0.02


@pytest.mark.slow
def test_the_sugar_way_leads_to_a_scene_too(files, quick):
    truth, seen, _ = scene("object")
    found = convert(files / "object.ply", detail="draft", vertices=VERTICES, surface="sugar")
    assert found.settings["surface"] == "sugar" and f_score(found, truth, seen, 0.01) > 0.97


def test_the_stages_are_timed(converted, stages):
    assert next(iter(stages.seconds)) == "read" and "chunks" in list(stages.seconds)[-2:]
    assert all(seconds >= 0 for seconds in stages.seconds.values()) and len(stages.seconds) > 5


def test_the_plan_says_what_convert_does(files, converted):
    planned = plan(files / "object.ply", detail="draft")
    assert planned["splats"] == converted.statistics["splats"] and planned["views"] == "32 virtual"
    assert planned["scene_from_splat"] == converted.scene_from_splat.tolist()
    assert planned["view_pixels"] == asdict(EFFORTS["draft"])["pixels"] and planned["sh_degree"] == 0
    assert planned["vertices"] == "50,000 or fewer"
    assert plan(files / "object.ply", vertices=10**8)["vertices"] == "100,000,000 or fewer"
    with_cameras = plan(files / "object.ply", detail="draft", cameras=files / "sparse")
    assert with_cameras["views"] == "32 of 48 trained"


@pytest.mark.parametrize("kind", ["empty", "unseen"])
def test_a_surface_of_which_nothing_is_left_is_refused(files, quick, monkeypatch, kind):
    def nothing(*_):
        """An empty mesh that a view saw, or an open one that none did."""
        view = View.look_at((0, 0, 5), (0, 0, 0), (0, 1, 0), 40.0, 8)
        depth = np.full((8, 8), np.float32(5 if kind == "empty" else np.nan))
        mesh = o3d.geometry.TriangleMesh()
        if kind == "unseen":
            mesh = o3d.geometry.TriangleMesh.create_sphere(1.0, 20)
            mesh.remove_triangles_by_index([100, 101])
        return mesh, [RenderedPicture.from_render(view, np.zeros((8, 8, 3)), depth, depth)]

    monkeypatch.setattr("splat2mesh.surface.solid.extract", nothing)
    with pytest.raises(InputError, match="no surface is left"):
        convert(files / "small.ply", detail="draft")


def test_fog_is_refused(tmp_path, quick):
    fog = plain(np.random.default_rng(0).normal(size=(500, 3)), 0.05, opacity=0.02)
    write_inria_ply(tmp_path / "fog.ply", fog)
    with pytest.raises(InputError, match="solid object"):
        convert(tmp_path / "fog.ply", detail="draft")


@pytest.mark.parametrize(
    ("setting", "message"),
    [
        ({"vertices": 3}, "at least 4"),
        ({"max_chunk_vertices": 2}, "at least 3"),
        ({"up": "+x"}, "expected one of auto"),
        ({"detail": "finest"}, "expected one of draft"),
        ({"surface": "magic"}, "expected one of field"),
        ({"background": "blur"}, "`background` blur: expected one of cut keep"),
    ],
)
def test_settings_that_make_no_sense_are_refused_before_the_file_is_read(setting, message):
    with pytest.raises(InputError, match=message):
        convert("no such file", **setting)
