"""A sequence as meshes: the same vertices and faces in all frames, what rests to the bit, files that others read."""

import json
from dataclasses import replace

import numpy as np
import pytest
import trimesh
from ball_splats import solid_ball
from gltf_check import validator_issues

from relight.animation.animation import Animation
from relight.cli import main as relight
from splat2mesh.cli import main
from splat2mesh.scene.scene import Scene
from splat2mesh.splats.formats import write_inria_ply, write_splats
from splat2mesh.surface.extract import EFFORTS, Effort

WORDS = ["--detail", "draft", "--vertices", "2000", "--max-chunk-vertices", "1500", "--texture", "none", "--sequence"]
SHIFT = np.float32([0.0, -3.0, 0.0])
"""Of the upper half in the third frame, in the frame of the splat, y down."""

FPS = 10


def write_frames(folder):
    """A ball at rest, then shaken, then with its upper half lifted off, the last after a gap of one number."""
    folder.mkdir()
    ball, above = solid_ball(), solid_ball().means[:, 1:2] < 0
    shake = 0.1 * ball.scales.max(axis=1, keepdims=True) * np.random.default_rng(0).uniform(-1, 1, ball.means.shape)
    still, shaken = ball, replace(ball, means=ball.means + shake)
    lifted = replace(ball, means=ball.means + above * SHIFT)
    for number, splats in {1: still, 2: shaken, 4: lifted}.items():
        write_inria_ply(folder / f"f_{number}.ply", splats)


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    """The frames in `frames`, the result in `out`, and what the command said."""
    folder = tmp_path_factory.mktemp("sequence")
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(folder)
        patch.setitem(EFFORTS, "draft", Effort(views=12, pixels=96, cells=80))
        write_frames(folder / "frames")
        assert main(["frames", *WORDS, "--fps", str(FPS), "-o", "out", "-q"]) == 0
    return folder / "out"


def frame(made, number):
    """(points, faces) of the chunks of a frame, by a reader of others, each in the order of its file."""
    parts = trimesh.load(made / "frames" / f"f_{number}.glb", process=False).geometry
    return [(np.asarray(parts[name].vertices), np.asarray(parts[name].faces)) for name in sorted(parts)]


def test_it_is_the_scene_of_the_first_frame(made):
    scene = Scene.load(made)
    assert scene.source["file"] == "f_1.ply" and len(scene.chunks) > 1
    for chunk, (points, faces) in zip(scene.chunks, frame(made, 1), strict=True):
        np.testing.assert_array_equal(points[: len(chunk.vertices)], chunk.vertices)
        np.testing.assert_array_equal(points[faces], chunk.vertices[chunk.faces])


def test_what_rests_keeps_every_bit_and_what_moves_moves_as_its_splats(made):
    for first, still, moved in zip(*(frame(made, number) for number in (1, 2, 4)), strict=True):
        for found in (still, moved):
            np.testing.assert_array_equal(found[1], first[1])
        np.testing.assert_array_equal(still[0], first[0])
        whole = np.linalg.norm(np.cross(*np.diff(moved[0][moved[1]], axis=1).transpose(1, 0, 2)), axis=1) > 0.0
        used = np.unique(moved[1][whole])
        by = moved[0][used] - first[0][used]
        up = (by != 0.0).any(axis=1)
        # A shift is found to a rounding of float32 at about 3; a splat of the seam reaches over it by its width.
        np.testing.assert_allclose(by[up], np.broadcast_to(-SHIFT, (up.sum(), 3)), atol=2e-6)
        width = solid_ball().scales.max()
        assert (first[0][used][up, 1] > -width).all() and (first[0][used][~up, 1] < width).all()
        assert 0.9 < whole.mean()


def test_faces_that_tear_leave_nothing_behind(made):
    for points, faces in frame(made, 4):
        lengths = np.linalg.norm(points[faces] - points[np.roll(faces, 1, axis=1)], axis=2)
        assert lengths.max() < 1.0 < abs(SHIFT[1])  # no face reaches over the gap


def test_one_file_plays_all_frames(made):
    played = Animation(made / "sequence.glb")
    assert played.duration_s == pytest.approx(3 / FPS)  # of numbers 1 to 4
    for time, number in ((0.0, 1), (1 / FPS, 2), (3 / FPS, 4)):
        for chunk, (points, faces) in zip(played.frame(time).chunks, frame(made, number), strict=True):
            np.testing.assert_array_equal(chunk.faces, faces)
            np.testing.assert_allclose(chunk.vertices, points, atol=1e-6)  # a difference added in float32
    half = [chunk.vertices for chunk in played.frame(2 / FPS).chunks]
    ends = [[points for points, _ in frame(made, number)] for number in (2, 4)]
    for found, first, second in zip(half, *ends, strict=True):
        np.testing.assert_allclose(found, (first + second) / 2, atol=1e-5)


def test_the_files_are_valid_and_no_larger_than_what_moves(made):
    for path in (made / "sequence.glb", made / "frames" / "f_4.glb"):
        found = validator_issues(path)
        assert found["numErrors"] == found["numWarnings"] == 0
    moved = sum((a[0] != b[0]).any(axis=1).sum() for a, b in zip(frame(made, 1), frame(made, 4), strict=True))
    grown = (made / "sequence.glb").stat().st_size - (made / "frames" / "f_1.glb").stat().st_size
    assert grown < 2 * (4 + 12) * moved + 8000  # rows and differences of two attributes, and the JSON of 3 targets


def test_relight_takes_the_folder(made):
    assert relight([str(made), "--env", "noon", "--method", "analytic", "--bands", "3", "--format", "glb", "-q"]) == 0
    assert (made / "relit" / "noon_0" / "relit.glb").is_file()


def test_frames_with_splats_of_their_own_are_meshed_alone(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setitem(EFFORTS, "draft", Effort(views=12, pixels=96, cells=80))
    (tmp_path / "frames").mkdir()
    for number in (1, 2, 3):
        write_splats(tmp_path / "frames" / f"{number}.spz", solid_ball().take(slice(number > 2, None)), "spz")
    for number in (0, 2):
        (tmp_path / "frames" / f"{number}.spz").write_bytes(b"")
    assert main(["frames", *WORDS, "--json"]) == 0
    said = capsys.readouterr()
    report = json.loads(said.out)
    assert report["frames"] == {"1.spz": "at rest", "3.spz": "alone"} and not report["played"]
    assert said.err.count("frame 0 is left out") == said.err.count("frame 2 is left out") == 1
    assert {path.name for path in (tmp_path / "frames_scene" / "frames").iterdir()} == {"1.glb", "3.glb"}
    assert not (tmp_path / "frames_scene" / "sequence.glb").exists()


def test_frames_per_second_are_of_a_sequence(tmp_path, capsys):
    assert main([str(tmp_path), "--fps", "12"]) == 2
    assert "--fps: it belongs to --sequence" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("names", "words", "message"),
    [
        (["1.ply", "2.spz"], [], "several formats (1 ply, 1 spz)"),
        (["a1.ply", "b1.ply"], [], "holds 2 sequences"),
        (["1.ply"], [], "holds one frame"),
        (["1.ply", "2.ply"], [], "holds no frame that can be read"),
        (["1.ply", "2.ply"], ["--fps", "0"], "--fps 0: frames a second must be above 0"),
        (["1.ply", "2.ply"], ["--plan"], "--plan: not supported for a sequence"),
        (["1.ply", "2.ply"], ["--workers", "2"], "--tiles: not supported for a sequence"),
    ],
)
def test_what_is_no_sequence_is_refused_in_one_line(tmp_path, monkeypatch, capsys, names, words, message):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "frames").mkdir()
    for name in names:
        (tmp_path / "frames" / name).write_bytes(b"")
    assert main(["frames", "--sequence", *words]) == 2
    said = [line for line in capsys.readouterr().err.splitlines() if not line.startswith("warning: ")]
    assert len(said) == 1 and message in said[0]
    assert {entry.name for entry in tmp_path.iterdir()} == {"frames"}
