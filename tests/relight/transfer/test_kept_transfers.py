"""What a scene keeps for its next light: found again to the bit, or traced again, whatever happened to its folder."""

import shutil

import numpy as np
import pytest
from plan_scenes import corner, difference, occluder_of, turned

from relight import Environment, Relighter
from relight.transfer import store
from relight.transfer.bounce_places import BouncePlaces, Shooting
from relight.transfer.bounces import Interreflection, with_bounces
from relight.transfer.settings import Settings
from relight.transfer.store import Cache
from splat2mesh.scene.meshfile import write_mesh_ply
from splat2mesh.scene.scene import Scene

ARRAYS = {"values": np.arange(1000.0), "names": np.array(["a", "bc"]), "nothing": np.zeros((0, 3), np.float32)}


@pytest.fixture(scope="module")
def saved(tmp_path_factory):
    """A scene folder that every test copies: a corner of 507 vertices."""
    folder = tmp_path_factory.mktemp("saved") / "corner"
    scene, _ = corner(12)
    scene.save(folder)
    return folder


@pytest.fixture
def folder(saved, tmp_path):
    return shutil.copytree(saved, tmp_path / "corner")


@pytest.fixture(scope="module")
def noon():
    return Environment.load("noon")


def opened(folder, **options):
    """A Relighter of a new run."""
    scene = Scene.load(folder)
    return Relighter(scene, cache=Cache.of_scene(scene), **options)


def grey(folder):
    return np.full(Scene.load(folder).vertices.shape, 0.7, np.float32)


@pytest.mark.parametrize("obstacle", ["read-only", "file", "full"])
def test_a_folder_that_takes_nothing_does_no_harm(folder, noon, monkeypatch, obstacle):
    if obstacle == "file":
        (folder / store.FOLDER).write_text("in the way")
    elif obstacle == "full":
        monkeypatch.setattr(np, "savez", lambda file, **arrays: file.write(b"half") and refuse())
    else:
        monkeypatch.setattr(store, "staged_file", lambda path: refuse())
    radiance = opened(folder, rays=16).shade(noon)
    np.testing.assert_array_equal(radiance, Relighter(Scene.load(folder), rays=16).shade(noon))
    left = list((folder / store.FOLDER).iterdir()) if obstacle != "file" else []
    assert left == []


def refuse():
    raise OSError(28, "No space left on device")


def test_a_mesh_file_keeps_nothing_beside_it(tmp_path, noon):
    scene, _ = corner(4)
    write_mesh_ply(tmp_path / "corner.ply", scene.chunks[0])
    for each in (Scene.load(tmp_path / "corner.ply"), scene):
        assert Cache.of_scene(each).folder is None
    opened(tmp_path / "corner.ply", rays=8).shade(noon)
    assert [path.name for path in tmp_path.iterdir()] == ["corner.ply"]


def test_a_second_run_traces_nothing(folder, noon):
    first = opened(folder)
    lit = first.shade(noon, grey(folder))
    assert first.rays_traced > 0
    second = opened(folder)
    np.testing.assert_array_equal(second.shade(noon, grey(folder)), lit)
    assert second.rays_traced == 0
    # Another light, turned, is the same transfer under other coefficients.
    sunset = Environment.load("sunset").rotated(70.0)
    np.testing.assert_array_equal(opened(folder).shade(sunset), first.shade(sunset))


def test_another_run_with_a_plan_finds_plan_and_transfer(folder):
    light = Environment.load("noon")
    first = opened(folder, tolerance=0.03)
    lit, plan = first.shading(light, grey(folder)), first.plan_for(light, grey(folder))
    second = opened(folder, tolerance=0.03)
    again = second.shading(Environment.load("noon").rotated(40.0).rotated(-40.0), grey(folder))
    np.testing.assert_array_equal(again.radiance, lit.radiance)
    assert second.rays_traced == 0 and again.settings == lit.settings
    assert second.plan_for(light, grey(folder)).as_dict() == plan.as_dict()
    assert opened(folder, tolerance=0.3).plan_for(light, grey(folder)).tolerance == 0.3
    assert opened(folder, tolerance=0.03).plan_for(light).contributions != plan.contributions  # white is another


def test_a_plan_that_is_broken_is_made_again(folder):
    """As it is made where none is kept: beside transfers that are there already, which cost nothing now."""
    light = Environment.load("noon")
    opened(folder, tolerance=0.03).shading(light)
    (path,) = (folder / store.FOLDER).glob("plan-*.npz")
    path.unlink()
    made = opened(folder, tolerance=0.03).shading(light).settings
    kept = Cache.of_scene(Scene.load(folder))
    for text in ("{", "{}", "[]", '{"settings": 1}'):
        kept.put("plan", *path.stem.split("-")[1:], plan=np.array(text))
        assert opened(folder, tolerance=0.03).shading(light).settings == made


def test_a_torn_transfer_is_traced_again(folder, noon):
    lit = opened(folder, rays=16).shade(noon)
    for path in (folder / store.FOLDER).glob("*.npz"):
        path.write_bytes(path.read_bytes()[: path.stat().st_size // 2])
    again = opened(folder, rays=16)
    np.testing.assert_array_equal(again.shade(noon), lit)
    assert again.rays_traced == 16 * 507


def test_another_mesh_in_the_folder_is_traced_anew(folder, noon):
    opened(folder, rays=16).shade(noon)
    scene, _ = corner(12)
    other = turned(scene, 30.0)
    other.save(folder.parent / "other")
    shutil.copytree(folder / store.FOLDER, folder.parent / "other" / store.FOLDER)
    relighter = opened(folder.parent / "other", rays=16)
    np.testing.assert_array_equal(relighter.shade(noon), Relighter(other, rays=16).shade(noon))
    assert relighter.rays_traced == 16 * 507


@pytest.mark.parametrize("change", [{"seed": 1}, {"rays": 96}])
def test_other_rays_are_not_taken_for_these(folder, noon, change):
    opened(folder, rays=32, bands=4).shade(noon)
    asked = {"rays": 32, "bands": 4} | change
    found, fresh = opened(folder, **asked), Relighter(Scene.load(folder), **asked)
    if "seed" in change:
        np.testing.assert_array_equal(found.shade(noon), fresh.shade(noon))
        assert found.rays_traced == 32 * 507
    else:  # 32 grow to 128, which serve for 96
        assert found.shading(noon).settings.rays == 128 and found.rays_traced == 96 * 507
        assert difference(found.transfer, fresh.transfer) < 0.05


def test_more_bands_are_gathered_from_kept_rays(folder, noon):
    opened(folder, rays=32, bands=3).shade(noon)
    more = opened(folder, rays=32, bands=8)
    radiance = more.shade(noon)
    assert more.rays_traced == 0
    np.testing.assert_array_equal(radiance, Relighter(Scene.load(folder), rays=32, bands=8).shade(noon))
    # And fewer bands are the first of more.
    fewer = opened(folder, rays=32, bands=5)
    fewer.shade(noon)
    assert fewer.rays_traced == 0
    np.testing.assert_array_equal(fewer.transfer[:, :25], more.transfer[:, :25])


def test_twice_the_rays_trace_the_new_half(folder, noon):
    opened(folder, rays=32).shade(noon)
    twice, again = opened(folder, rays=64), opened(folder, rays=64)
    lit = twice.shade(noon)
    assert twice.rays_traced == 32 * 507
    np.testing.assert_array_equal(again.shade(noon), lit)
    assert again.rays_traced == 0
    # What is there is not thrown away for less.
    fewer = opened(folder, rays=16)
    assert fewer.shading(noon).settings.rays >= 16 and fewer.rays_traced == 0


def test_the_capture_is_estimated_by_rays_of_its_own(folder):
    """However many there are already, and wherever they came from."""
    settings = Settings("raytraced", 3, 16, bounce_rays=32)
    first = opened(folder, rays=16).precomputed.alone(settings).interreflection(32, opened(folder, rays=16).transfer)
    opened(folder, rays=16).interreflection(16)
    later = opened(folder, rays=16)
    np.testing.assert_array_equal(
        later.precomputed.alone(settings).interreflection(32, later.transfer).hits, first.hits
    )


def test_interreflection_comes_back_to_the_bit(folder, noon):
    scene = Scene.load(folder)
    visible = np.random.default_rng(0).random(len(scene.vertices))
    occluder = occluder_of(scene)
    kept = Cache.of_scene(scene)
    kept.put("bounces", 24, **BouncePlaces.shot(24, Shooting(occluder, 4))._asdict())
    places = BouncePlaces.restored(kept.get("bounces", 24), 24, len(occluder.faces), np.ones(len(scene.vertices), bool))
    light = np.random.default_rng(1).random((len(scene.vertices), 3), np.float32)
    for each in (None, visible):
        fresh = Interreflection(occluder, 24, 4, each)
        restored = Interreflection.of_places(places, 24, occluder, each)
        np.testing.assert_array_equal(restored.bounce(light), fresh.bounce(light))
        assert (restored.entries, restored.back_hits, restored.rays) == (fresh.entries, fresh.back_hits, 24)
        for name in ("hits", "shares"):
            np.testing.assert_array_equal(getattr(restored, name), getattr(fresh, name))
        one, other = (with_bounces(light, grey(folder), matrix) for matrix in (restored, fresh))
        np.testing.assert_array_equal(one[0], other[0])
        assert one[1] == other[1]


# -- what goes


def test_what_a_better_transfer_stands_for_is_not_kept_beside_it(folder, noon):
    cache = Cache.of_scene(Scene.load(folder))
    opened(folder, rays=16, bands=3).shade(noon)
    opened(folder, rays=16, bands=3, seed=1).shade(noon)
    opened(folder, rays=32, bands=5).shade(noon)
    stored = {tuple(key[1:4]) for key in cache.settings_of("transfer")}
    assert stored == {(5, 32, 0), (3, 16, 1)}
    opened(folder, rays=64, bands=4).shade(noon)  # neither stands for the other
    assert {key[1:3] for key in cache.settings_of("transfer") if key[3] == 0} == {(5, 32), (4, 64)}
    again = opened(folder, rays=16, bands=3)
    again.shade(noon)
    assert again.rays_traced == 0


def test_bounces_of_more_rays_take_the_place_of_others(folder, noon):
    cache, white = Cache.of_scene(Scene.load(folder)), grey(folder)

    def kept_after(rays):
        relighter = opened(folder, rays=16)
        relighter.shade(noon, white)
        relighter.interreflection(rays)
        return sorted(each[0] for each in cache.settings_of("bounces"))

    assert [kept_after(rays) for rays in (64, 256, 128)] == [[64], [256], [256]]
    assert [opened(folder, rays=16).interreflection(rays).rays for rays in (128, 16)] == [256, 256]


def test_bounces_that_another_run_has_replaced_are_found_where_they_are_now(folder, noon, monkeypatch):
    first = opened(folder, rays=16)
    first.shade(noon, grey(folder))
    cache, other = Cache.of_scene(Scene.load(folder)), opened(folder, rays=16)
    listed = cache.settings_of("bounces")
    first.interreflection(128)
    assert cache.settings_of("bounces") != listed
    every = cache.settings_of("bounces")
    monkeypatch.setattr(Cache, "settings_of", lambda self, kind: listed + every if kind == "bounces" else [])
    assert other.precomputed.interreflection(64, first.transfer).rays == 128
    assert other.rays_traced == 0
