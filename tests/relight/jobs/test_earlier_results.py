"""A second call into a folder: the same settings add, others ask, and nothing that is there is lost."""

import json
import os
from dataclasses import fields
from types import SimpleNamespace

import numpy as np
import pytest
from viewer_scenes import ball_on_plate

from relight import Environment, LightingOptions, relight_scene
from relight.cli import main
from relight.jobs.earlier_results import Earlier, settings_of
from splat2mesh.base.errors import DataWarning, InputError

LIGHT = "--env", "noon", "--method", "analytic", "--bands", "3", "--albedo", "captured", "-q"


@pytest.fixture
def scene(tmp_path):
    ball_on_plate().save(tmp_path / "scene")
    return tmp_path / "scene"


@pytest.fixture
def relight(scene, tmp_path, capsys):
    """Runs the command into `out`: its exit code, and what it said."""

    def relight(*more, light=LIGHT):
        light = light[2:] if "--env" in more else light  # which would be another light beside it
        code = main([str(scene), "-o", str(tmp_path / "out"), *light, *more])
        return code, capsys.readouterr().err

    return relight


def contents(folder):
    return {path.relative_to(folder).as_posix(): path.read_bytes() for path in folder.rglob("*") if path.is_file()}


def report_in(folder):
    return json.loads((folder / "report.json").read_text())


LASTING = "seconds", "peak_mb", "plan"


def lasting(report):
    return {name: value for name, value in report.items() if name not in LASTING}


def test_two_calls_with_one_format_each_leave_what_one_call_with_both_leaves(relight, tmp_path):
    assert relight("--format", "npy,ply") == (0, "")
    both = contents(tmp_path / "out")
    expected = lasting(report_in(tmp_path / "out"))
    (tmp_path / "out").rename(tmp_path / "both")
    assert relight("--format", "npy")[0] == relight("--format", "ply")[0] == 0
    found = contents(tmp_path / "out")
    assert found.keys() == both.keys() == {"radiance.npy", "relit.ply", "report.json"}
    assert all(found[name] == both[name] for name in ("radiance.npy", "relit.ply"))
    again = lasting(report_in(tmp_path / "out"))
    assert sorted(again.pop("files")) == sorted(expected.pop("files")) == ["radiance.npy", "relit.ply"]
    assert again == expected


def test_the_same_call_again_changes_no_byte(relight, tmp_path):
    assert relight("--format", "npy,png", "--sheet")[0] == 0
    before, report = contents(tmp_path / "out"), lasting(report_in(tmp_path / "out"))
    assert relight("--format", "npy,png", "--sheet") == (0, "")
    after = contents(tmp_path / "out")
    assert lasting(report_in(tmp_path / "out")) == report
    del before["report.json"], after["report.json"]
    assert after == before


def test_a_sheet_of_the_same_lights_is_written_again(scene, tmp_path, capsys):
    command = [str(scene), "-o", str(tmp_path / "all"), *LIGHT, "--rotate", "0:90:90", "--format", "png", "--sheet"]
    assert main(command) == 0
    sheet = (tmp_path / "all" / "sheet.png").read_bytes()
    assert main(command) == 0 and (tmp_path / "all" / "sheet.png").read_bytes() == sheet


@pytest.mark.parametrize(
    ("more", "message"),
    [
        (["--env", "sunset"], "--env noon, now sunset"),
        (["--rotate", "45"], "now 45"),
        (["--albedo", "white"], "--albedo captured, now white"),
        (["--exposure", "1"], "not given, now 1"),
        (["--bands", "2"], "--bands 3, now 2"),
        (["--seed", "1"], "--seed 0, now 1"),
        (["--tolerance", "5%"], "--tolerance not given, now 0.05"),
        (["--sky", "keep"], "--sky new, now keep"),
    ],
)
def test_other_settings_ask_in_one_line_that_names_them(relight, tmp_path, more, message):
    assert relight("--format", "npy")[0] == 0
    before = contents(tmp_path)
    code, said = relight("--format", "ply", *more)
    assert code == 2 and said.count("\n") == 1 and message in said and "--overwrite" in said
    assert contents(tmp_path) == before


def test_another_scene_asks(relight, scene, tmp_path):
    assert relight("--format", "npy")[0] == 0
    changed = ball_on_plate()
    changed.chunks[0].vertices[:] *= 1.5
    changed.save(scene, overwrite=True)
    code, said = relight("--format", "ply")
    assert code == 2 and "the scene differs" in said


def test_a_light_counts_by_its_content_and_not_by_its_path(scene, tmp_path, capsys):
    light = Environment(np.random.default_rng(1).gamma(1.0, 1.0, (8, 16, 3)).astype(np.float32), "sky")
    settings = {"bands": 2, "albedo": "white"}
    relight_scene(scene, light, "analytic", formats=["npy"], **settings).save(tmp_path / "out")
    same = Environment(light.radiance.copy(), "sky")
    relight_scene(scene, same, "analytic", formats=["ply"], **settings).save(tmp_path / "out")
    assert set(report_in(tmp_path / "out")["files"]) == {"radiance.npy", "relit.ply"}
    brighter = Environment(light.radiance * 2.0, "sky")
    with pytest.raises(InputError, match="`env` sky had other content"):
        relight_scene(scene, brighter, "analytic", formats=["ply"], **settings).save(tmp_path / "out")
    with pytest.raises(InputError, match="`angle_deg` 0, now 30"):
        turned = relight_scene(scene, same, "analytic", angle_deg=30.0, formats=["ply"], **settings)
        turned.save(tmp_path / "out")


def asked(**changes):
    """What is asked of a scene and a light in memory."""
    fields = {"albedo": "white", "capture_env": None, "exposure_ev": None, "formats": None, "baked": (), "sky": "new"}
    fields |= {"scene": ball_on_plate(), "lighting": LightingOptions(), "angles_deg": (0.0,)}
    fields |= {"texture_size": None, "harmonics": "zero", "white_at": None}
    plain = {"inserted": (), "only": (), "keep": (), "parts": (), "shadow_of_parts": False}
    return SimpleNamespace(**plain | fields | changes)


@pytest.mark.parametrize(
    ("files", "name", "value", "other"),
    [
        ({"baked": ["texture"]}, "texture_size", 64, 128),
        ({"formats": ["albedo-splat"]}, "harmonics", "zero", "keep"),
    ],
)
def test_what_only_some_files_depend_on_is_asked_about_only_with_them(tmp_path, files, name, value, other):
    first, without, second = (
        settings_of(asked(**each), "noon", 0.0)
        for each in (files | {name: value}, {name: other}, files | {name: other})
    )
    (tmp_path / "report.json").write_text(json.dumps({"files": [], "settings": first}))
    kept = Earlier(tmp_path, without).joined({"files": ["relit.glb"]})
    assert kept["settings"] == first and name not in without
    with pytest.raises(InputError, match=f"`{name}`"):
        Earlier(tmp_path, second)


def test_a_page_of_other_lights_has_other_settings():
    alone = settings_of(asked(formats=["web"]), "noon", 0.0, ["noon"])
    two = [
        settings_of(asked(formats=["web"]), "noon", 0.0, lights) for lights in (["noon", "sunset"], ["sunset", "noon"])
    ]
    assert two[0] == two[1] == alone | {"lights": [{"name": "sunset"}]} and alone["lights"] == []
    assert "lights" not in settings_of(asked(), "noon", 0.0, ["noon", "sunset"])


def test_settings_are_json_and_the_same_for_what_means_the_same(tmp_path):
    first = settings_of(
        asked(angles_deg=(405.0, 0.0, 45.0), lighting=LightingOptions(effects="shadows,sun")), "Noon", 405
    )
    again = settings_of(asked(angles_deg=(0.0, 45.0), lighting=LightingOptions(effects="sun shadows")), "noon", 45.0)
    assert first == again == json.loads(json.dumps(first)) and first["angles_deg"] == [0.0, 45.0]
    assert {each.name for each in fields(LightingOptions)} <= first.keys()


@pytest.mark.parametrize("field", ["only", "keep", "parts"])
def test_parts_whose_names_differ_by_case_are_other_parts(field):
    first, other = (settings_of(asked(**{field: [name]}), "noon", 0.0) for name in ("object:Vase", "object:vase"))
    assert first[field] != other[field] and {**first, field: other[field]} == other


def test_overwrite_replaces_what_it_writes_and_deletes_nothing(relight, tmp_path):
    assert relight("--format", "npy,ply")[0] == 0
    out = tmp_path / "out"
    (out / "notes").mkdir()
    (out / "notes" / "mine.txt").write_text("not to be lost")
    (out / "link").symlink_to("notes/mine.txt")
    ply, npy = (out / "relit.ply").read_bytes(), (out / "radiance.npy").read_bytes()
    code, said = relight("--format", "npy", "--env", "sunset", "--overwrite")
    assert code == 0 and said.count("\n") == 1
    assert "files of other settings stay there, and the report leaves them out (1): relit.ply" in said
    assert (out / "notes" / "mine.txt").read_text() == "not to be lost" and os.readlink(out / "link")
    assert (out / "relit.ply").read_bytes() == ply and (out / "radiance.npy").read_bytes() != npy
    report = report_in(out)
    assert report["files"] == ["radiance.npy"] and report["settings"]["env"]["name"] == "sunset"
    assert relight("--format", "ply", "--env", "sunset") == (0, "")  # the stale file is of these settings now
    assert (out / "relit.ply").read_bytes() != ply
    assert sorted(report_in(out)["files"]) == ["radiance.npy", "relit.ply"]


def test_a_file_that_somebody_removed_is_no_longer_listed(relight, tmp_path):
    assert relight("--format", "npy,ply")[0] == 0
    (tmp_path / "out" / "radiance.npy").unlink()
    assert relight("--format", "ply")[0] == 0
    assert report_in(tmp_path / "out")["files"] == ["relit.ply"]


def test_results_behind_a_link_are_added_to_where_they_are(relight, tmp_path):
    assert relight("--format", "npy")[0] == 0
    (tmp_path / "out").rename(tmp_path / "elsewhere")
    (tmp_path / "out").symlink_to("elsewhere")
    assert relight("--format", "ply")[0] == 0
    assert (tmp_path / "out").is_symlink()
    assert {"radiance.npy", "relit.ply"} <= {path.name for path in (tmp_path / "elsewhere").iterdir()}


@pytest.mark.parametrize("report", ["{}", "[]", "half a rep", '{"settings": 3, "files": [7]}'])
def test_a_report_that_names_no_settings_asks(relight, tmp_path, report):
    (tmp_path / "out").mkdir()
    (tmp_path / "out" / "report.json").write_text(report)
    code, said = relight("--format", "npy")
    assert code == 2 and "its report names none" in said and "--overwrite" in said
    assert relight("--format", "npy", "--overwrite") == (0, "")
    assert report_in(tmp_path / "out")["files"] == ["radiance.npy"]


def test_a_failed_addition_leaves_the_earlier_results_alone(scene, tmp_path, monkeypatch):
    found = relight_scene(scene, "noon", "analytic", albedo="white", formats=["npy"])
    found.save(tmp_path / "out")
    before = contents(tmp_path)
    monkeypatch.setattr("relight.output.mesh_files.write_mesh_ply", lambda *_: 1 / 0)
    more = relight_scene(scene, "noon", "analytic", albedo="white", formats=["npy", "ply"])
    with pytest.raises(ZeroDivisionError):
        more.save(tmp_path / "out")
    assert contents(tmp_path) == before and not list(tmp_path.glob(".*"))


def test_stale_files_are_named_in_a_warning_of_the_library_too(scene, tmp_path):
    relight_scene(scene, "noon", "analytic", albedo="white", formats=["npy"]).save(tmp_path / "out")
    with pytest.warns(DataWarning, match="files of other settings"):
        relight_scene(scene, "sunset", "analytic", albedo="white", formats=["ply"]).save(tmp_path / "out", True)
