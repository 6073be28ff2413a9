"""A sequence of splats in a new light: one captured light for all frames, and what an interrupted run leaves."""

import json
import re
import shutil
from dataclasses import replace

import numpy as np
import pytest
from ball_splats import solid_ball
from PIL import Image

from relight.animation.film import FILM, encoder
from relight.cli import main
from relight.jobs.sequence import FrameFolder
from splat2mesh.splats.formats import read_splats, write_inria_ply, write_splats

LIGHT = ["--sequence", "--env", "noon", "--method", "analytic", "--bands", "3", "--vertices", "4000"]
STILL = [f"f_{number:02d}.ply" for number in range(10)]
MOVED, ALONE = "f_10.ply", "f_11.ply"
NOISE = 0.05
"""Of the constant coefficients: 1.4% of white."""


def frames(folder):
    """Ten frames of a ball at rest with noise of their own, and two of it elsewhere, the last with fewer splats."""
    folder.mkdir()
    ball, rng = solid_ball(), np.random.default_rng(0)
    for name in STILL:
        noise = NOISE * rng.standard_normal(ball.sh.shape, np.float32)
        shake = 0.1 * ball.scales.max(axis=1, keepdims=True) * rng.uniform(-1, 1, ball.means.shape)
        write_inria_ply(folder / name, replace(ball, sh=ball.sh + noise, means=ball.means + shake))
    moved = replace(ball, means=ball.means + np.float32([3.0, 0.0, 1.0]))
    write_inria_ply(folder / MOVED, moved)
    write_inria_ply(folder / ALONE, moved.take(np.arange(len(ball)) != 1))


@pytest.fixture(scope="module")
def lit(tmp_path_factory):
    """The frames in `frames`, and in the new light in `out`."""
    folder = tmp_path_factory.mktemp("sequence")
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(folder)
        frames(folder / "frames")
        assert main(["frames", *LIGHT, "-o", "out"]) == 0
    return folder


def light_of(splats):
    """Log of display values, lifted as light is by the sRGB curve: (N, 3)."""
    return 2.4 * np.log(np.maximum(splats.colors_diffuse, 0.0) + 0.055)


def test_the_light_of_what_rests_flickers_less_than_the_capture(lit):
    before = np.stack([light_of(read_splats(lit / "frames" / name)) for name in STILL])
    after = np.stack([light_of(read_splats(lit / "out" / name)) for name in STILL])
    seen = np.linalg.norm(solid_ball().means, axis=1) > 1.9
    noise, flicker = (np.sqrt(np.var(each[:, seen], axis=0).mean()) for each in (before, after - before))
    assert noise > 0.02 and np.abs((after - before)[:, seen]).mean() > 0.1
    assert flicker < 0.5 * noise  # below the capture's own, by a margin: the fit follows a part of the noise


def test_a_frame_elsewhere_has_the_light_of_the_first(lit):
    report = json.loads((lit / "out" / "report.json").read_text())
    states = {name: entry["state"] for name, entry in report["frames"].items()}
    assert states == dict.fromkeys(STILL, "at rest") | {MOVED: "moving", ALONE: "alone"}
    still = np.mean([read_splats(lit / "out" / name).colors_diffuse for name in STILL], axis=0)
    captured, rows = solid_ball().colors_diffuse, np.arange(len(still)) != 1
    seen = np.linalg.norm(solid_ball().means, axis=1) > 1.9
    moved, alone = (read_splats(lit / "out" / name).colors_diffuse for name in (MOVED, ALONE))
    assert np.abs(still - captured)[seen].mean() > 0.05
    assert np.abs(alone - still[rows])[seen[rows]].mean() < 0.02
    # On the same mesh nothing but the noise differs, of which the mean and the first frame leave a part.
    assert np.abs(moved - still)[seen].mean() < 0.5 * 0.014


def test_a_part_in_a_light_of_its_own_moves_with_its_rows(lit, monkeypatch):
    monkeypatch.chdir(lit)
    (lit / "few").mkdir()
    for name in (STILL[0], MOVED):
        shutil.copy(lit / "frames" / name, lit / "few" / name)
    sphere = "sphere:at=0,-2,0,radius=1"
    asked = {"plain": [], "parted": ["--part", sphere, "env=sunset"], "only": ["--only", sphere]}
    for name, words in asked.items():
        assert main(["few", *LIGHT, *words, "-o", name]) == 0
    assert main(["few", *[each.replace("noon", "sunset") for each in LIGHT], "-o", "other"]) == 0
    inside = np.linalg.norm(read_splats(lit / "few" / STILL[0]).means - [0, -2, 0], axis=1)
    for name in (STILL[0], MOVED):
        plain, parted, only, other = (read_splats(lit / each / name).sh for each in (*asked, "other"))
        np.testing.assert_array_equal(parted[inside > 1.6], plain[inside > 1.6])
        np.testing.assert_array_equal(parted[inside < 1], other[inside < 1])
        np.testing.assert_array_equal(only[inside > 1.6], read_splats(lit / "few" / name).sh[inside > 1.6])
        np.testing.assert_array_equal(only[inside < 1], plain[inside < 1])
        assert np.abs(plain - other)[inside < 1].mean() > 0.05


def test_only_colours_change(lit):
    for name in (STILL[3], MOVED, ALONE):
        before, after = (read_splats(lit / folder / name) for folder in ("frames", "out"))
        for field in ("means", "scales", "quats_wxyz", "opacities"):
            np.testing.assert_array_equal(getattr(before, field), getattr(after, field))


def test_an_interrupted_run_goes_on_where_it_stopped(lit, monkeypatch):
    monkeypatch.chdir(lit)
    done, write = [], FrameFolder.write

    def stopped(self, frame, *rest):
        if len(done) == 4:
            raise KeyboardInterrupt
        done.append(frame.number)
        write(self, frame, *rest)

    with monkeypatch.context() as patch:
        patch.setattr(FrameFolder, "write", stopped)
        assert main(["frames", *LIGHT, "-o", "again"]) != 0
    assert sorted(path.name for path in (lit / "again").iterdir()) == [*STILL[:4], "report.json"]
    kept = {path.name: path.stat().st_mtime_ns for path in (lit / "again").glob("*.ply")}
    (lit / "again" / STILL[2]).unlink()
    assert main(["frames", *LIGHT, "-o", "again"]) == 0
    for name in (*STILL, MOVED, ALONE):
        assert (lit / "again" / name).read_bytes() == (lit / "out" / name).read_bytes()
    for name in (STILL[0], STILL[1], STILL[3]):
        assert (lit / "again" / name).stat().st_mtime_ns == kept[name]


def test_results_of_another_light_are_not_mixed(lit, monkeypatch, capsys):
    monkeypatch.chdir(lit)
    words = [word if word != "noon" else "sunset" for word in LIGHT]
    assert main(["frames", *words, "-o", "out"]) == 2
    assert "holds results of other settings" in capsys.readouterr().err


def test_frames_keep_their_format_and_each_angle_has_a_folder(lit, monkeypatch, capsys):
    monkeypatch.chdir(lit)
    (lit / "packed").mkdir()
    for number in (1, 3):
        write_splats(lit / "packed" / f"{number}.spz", solid_ball(), "spz")
    (lit / "packed" / "2.spz").write_bytes(b"")
    assert main(["packed", *LIGHT, "--rotate", "0:90:90"]) == 0
    assert "frame 2 is left out" in capsys.readouterr().err
    for angle in (0, 90):
        found = {path.name for path in (lit / "packed_scene" / "relit" / f"noon_{angle}").iterdir()}
        assert found == {"1.spz", "3.spz", "report.json"}
    assert len(read_splats(lit / "packed_scene" / "relit" / "noon_90" / "3.spz")) == 3000


def test_pictures_of_the_frames_make_a_film(lit, monkeypatch):
    monkeypatch.chdir(lit)
    (lit / "two").mkdir()
    for name in (STILL[0], MOVED):
        shutil.copy(lit / "frames" / name, lit / "two" / name)
    words = ["two", *LIGHT, "-o", "film", "--format", "splat", "png"]
    assert main([*words, "--fps", "10"]) == 0
    first, last = (np.asarray(Image.open(lit / "film" / f"{name[:4]}.png")) for name in (STILL[0], MOVED))
    assert first.shape == last.shape and (first != last).any(axis=2).mean() > 0.01
    report = json.loads((lit / "film" / "report.json").read_text())
    film = [FILM] * (encoder() is not None)
    assert report["files"] == [STILL[0], MOVED, f"{STILL[0][:4]}.png", f"{MOVED[:4]}.png", *film]
    assert all((lit / "film" / name).is_file() for name in report["files"])
    (lit / "film" / f"{MOVED[:4]}.png").unlink()
    assert main(words) == 0 and (lit / "film" / f"{MOVED[:4]}.png").is_file()


def test_a_page_plays_the_relit_frames(lit, monkeypatch, capsys):
    monkeypatch.chdir(lit)
    (lit / "three").mkdir()
    for name in (STILL[0], MOVED, ALONE):
        shutil.copy(lit / "frames" / name, lit / "three" / name)
    assert main(["three", *LIGHT, "-o", "paged", "--format", "web", "--fps", "12"]) == 0
    assert "paged/relit.html" in capsys.readouterr().out
    report = json.loads((lit / "paged" / "report.json").read_text())
    assert report["files"] == [STILL[0], MOVED, ALONE, "relit.html"]
    page = (lit / "paged" / "relit.html").read_text("utf-8")
    data = json.loads(re.search(r'id="live-data">(.*?)</script>', page)[1])
    assert [data[key] for key in ("fps", "splats", "packed")] == [12.0, 3000, True]
    low, high = data["camera"]["bounds"]  # of a ball of 2, 3 to the right in the second frame
    assert high[0] - low[0] > 6.0
    assert [each["file"] for each in data["frames"]] == [f"{number:04d}.compressed.ply" for number in range(3)]
    assert data["sky"]["file"] == "sky.rgbe"
    before = (lit / "paged" / STILL[0]).stat().st_mtime_ns
    assert main(["three", *LIGHT, "-o", "paged", "--format", "web"]) == 0  # the frames stay
    assert (lit / "paged" / STILL[0]).stat().st_mtime_ns == before


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["f_00.ply", "--sequence"], "--sequence: expected a folder of numbered splat files, found f_00.ply"),
        ([".", "--sequence", "--insert", "f_00.ply"], "--insert: a sequence does not heed it"),
        ([".", "--sequence", "--format", "glb"], "--format: a sequence has splat, and png and web on request"),
        ([".", "--sequence", "--fps", "0"], "frames per second must be above 0"),
        ([".", "--sequence", "--plan"], "--plan: not supported for a sequence"),
        ([".", "--sequence", "--sheet"], "--sheet: a sequence does not heed it"),
        ([".", "--sequence"], "several formats (1 ply, 1 spz)"),
    ],
)
def test_what_is_no_sequence_is_refused_before_anything_is_written(tmp_path, monkeypatch, capsys, words, message):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "f_00.ply").write_bytes(b"")
    (tmp_path / "f_01.spz").write_bytes(b"")
    assert main(words) == 2
    said = capsys.readouterr().err
    assert message in said and said.count("\n") == 1
    assert {entry.name for entry in tmp_path.iterdir()} == {"f_00.ply", "f_01.spz"}
