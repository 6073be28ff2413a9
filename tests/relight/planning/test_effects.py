"""Shadows, sun and bounces together: their sum, their reference, what each may and may not change."""

import json

import numpy as np
import open3d as o3d
import pytest

from relight import Environment, Relighter, cli
from relight.light.sun_split import split
from relight.options import LightingOptions
from relight.transfer import bounce_places, kept_bounces, precomputed
from relight.transfer.bounces import Interreflection, Sharing, visible_fraction
from relight.transfer.neighbors import Neighbors
from relight.transfer.occluder import Occluder
from relight.transfer.reference import reference
from relight.transfer.settings import BOUNCE_RAYS, EFFECTS
from relight.transfer.sunlight import sunlight
from relight.transfer.visibility import raytraced_scene
from splat2mesh.base.errors import InputError
from splat2mesh.scene.mesh import Mesh
from splat2mesh.scene.scene import Scene


def square(corner, edge_u, edge_v, count):
    """A square of count x count cells that faces edge_u x edge_v: vertices, normals, faces."""
    u, v = np.meshgrid(*2 * [np.linspace(0, 1, count + 1)], indexing="ij")
    vertices = np.asarray(corner) + u.reshape(-1, 1) * edge_u + v.reshape(-1, 1) * edge_v
    first = (np.arange(count)[:, None] * (count + 1) + np.arange(count)).reshape(-1, 1)
    faces = (first + np.array([0, count + 1, count + 2, 0, count + 2, 1])).reshape(-1, 3)
    return vertices, np.tile(np.cross(edge_u, edge_v), (len(vertices), 1)), faces


def ball(radius, center, resolution):
    mesh = o3d.geometry.TriangleMesh.create_sphere(radius, resolution)
    vertices = np.asarray(mesh.vertices)
    return vertices + center, vertices / radius, np.asarray(mesh.triangles)


def mesh_of(*parts, seed=0):
    """One mesh of parts (vertices, normals, faces), in random colours."""
    offsets = np.cumsum([0] + [len(vertices) for vertices, _, _ in parts[:-1]])
    vertices, normals, faces = zip(*parts, strict=True)
    vertices, normals = (np.concatenate(arrays).astype(np.float32) for arrays in (vertices, normals))
    faces = np.concatenate([part + offset for part, offset in zip(faces, offsets, strict=True)]).astype(np.int32)
    return Mesh(vertices, normals, faces, np.random.default_rng(seed).integers(0, 256, vertices.shape, np.uint8))


def corner_with_ball():
    """A ball that hovers in the corner of a floor and two walls: open sky, wide shadows and light sent back."""
    x, y, z = np.eye(3)
    floor, *walls = (square(*arguments, 10) for arguments in ((0 * x, z, x), (0 * x, x, y), (z, y, x)))
    return mesh_of(floor, *walls, ball(0.25, (0.4, 0.3, 0.45), 8))


def turned(mesh, angle_deg):
    """The mesh after an active Ry(+angle): +z goes to +x."""
    c, s = np.cos(np.radians(angle_deg)), np.sin(np.radians(angle_deg))
    matrix = np.array([[c, 0, s], [0, 1, 0], [-s, 0, c]])
    vertices, normals = ((a @ matrix.T).astype(np.float32) for a in (mesh.vertices, mesh.normals))
    return Mesh(vertices, normals, mesh.faces, mesh.colors_srgb)


def difference(found, expected):
    return np.linalg.norm(found - expected) / np.linalg.norm(expected)


@pytest.fixture(scope="module")
def corner():
    return corner_with_ball()


@pytest.fixture(scope="module")
def scene(corner):
    return Scene([corner])


@pytest.fixture(scope="module")
def albedo(corner):
    return np.random.default_rng(1).uniform(0.1, 0.9, corner.vertices.shape).astype(np.float32)


@pytest.fixture(scope="module")
def noon():
    return Environment.load("noon").rotated(20.0)


@pytest.fixture(scope="module")
def soft():
    """A rough random sky without darkness, with colour and direction."""
    return Environment(1.0 + np.random.default_rng(2).random((8, 16, 3), np.float32), "soft")


def constant(color):
    return Environment(np.tile(np.float32(color), (4, 8, 1)), "constant")


# -- what the light is made of


@pytest.mark.parametrize("effects", ["shadows", "shadows,sun", "shadows,bounces", "auto"])
@pytest.mark.parametrize("name", ["noon", "sunset"])
def test_shading_is_the_sum_of_its_parts(scene, albedo, effects, name):
    """Every part computed anew, and put together in float64, with the bounces as a dense matrix."""
    light, chosen = Environment.load(name).rotated(35.0), LightingOptions(effects=effects).chosen_effects
    shading = Relighter(scene, bands=6, rays=64, seed=3, effects=effects).shading(light, albedo)

    everything = Occluder(scene.vertices, scene.normals, scene.faces)
    transfer = raytraced_scene(everything, 6, 64, 3)
    rest, suns = split(light) if "sun" in chosen else (light, ())
    direct = transfer.astype(np.float64) @ rest.sh(6)
    if len(suns):
        direct = direct + sunlight(everything, slice(None), suns)
    radiance = increment = albedo * np.maximum(direct, 0.0)
    if "bounces" in chosen:
        neighbors = Neighbors(everything.origins, everything.normals, everything.faces)
        matrix = Interreflection(
            everything, BOUNCE_RAYS, 3, visible_fraction(transfer), sharing=Sharing(neighbors=neighbors)
        )
        dense = matrix.bounce(np.eye(len(transfer), dtype=np.float32)).astype(np.float64)
        for bounce in range(100):
            increment = albedo * (dense @ increment)
            radiance = radiance + increment
            if bounce < len(shading.bounces):  # found by a quarter of the hits
                share = np.linalg.norm(increment) / np.linalg.norm(radiance)
                assert shading.bounces[bounce] == pytest.approx(share, rel=0.1)
        assert difference(shading.radiance, radiance) < 1.5 * shading.settings.bounce_tolerance
    else:  # float32 sums of 36 products that cancel: some 1e-7 each of the brightest vertex
        np.testing.assert_allclose(shading.radiance, radiance, rtol=1e-5, atol=1e-6 * radiance.max())
    assert (shading.sun_count, len(suns) > 0) == (len(suns), "sun" in chosen)
    assert bool(shading.bounces) == ("bounces" in chosen)
    assert shading.radiance.dtype == np.float32


@pytest.mark.parametrize("angle_deg", [0.0, 130.0])
@pytest.mark.parametrize("name", ["noon", "sunset"])
def test_sun_cuts_the_error_against_the_full_image(corner, scene, name, angle_deg):
    """Measured with 256 rays: noon 18 and 21% without sun, 0.4 and 0.8% with; sunset 10 and 7%, 1.1 and 0.8%."""
    light = Environment.load(name).rotated(angle_deg)
    truth = reference(Occluder(corner.vertices, corner.normals, corner.faces), slice(None), light)
    without, sun = (difference(Relighter(scene, effects=some).shade(light), truth) for some in ("shadows", EFFECTS[:2]))
    assert sun < 0.02  # 256 rays leave 1% under a sky alone; a ray that grazes the ball tips a vertex
    assert without > 5 * sun  # 8 at least were measured


def test_a_constant_sky_shows_what_of_it_is_visible(corner, scene):
    """Exactly the fraction in the transfer, with no suns; and that fraction is the one of rays shot otherwise."""
    color = np.float32([0.5, 1.0, 3.0])
    relighter = Relighter(scene)
    shading = relighter.shading(constant(color))
    visible = visible_fraction(relighter.transfer)
    # Float32 rounding of 100 coefficients, of which 99 are rounding themselves
    np.testing.assert_allclose(shading.radiance, visible[:, None] * color, rtol=2e-6, atol=2e-6)
    assert (shading.sun_count, shading.bounces) == (0, [])
    assert visible.min() < 0.1 and visible.max() == pytest.approx(1.0, abs=0.1)

    everything = Occluder(corner.vertices, corner.normals, corner.faces)
    toward = np.random.default_rng(4).normal(size=(len(visible), 1024, 3))
    toward /= np.linalg.norm(toward, axis=2, keepdims=True)
    toward += corner.normals[:, None]  # a point on the sphere that touches the surface: cosine-distributed
    rays = np.concatenate([np.broadcast_to(everything.origins[:, None], toward.shape), toward], axis=2)
    counted = 1.0 - everything.occluded(rays.astype(np.float32)).mean(axis=1)
    # Standard deviation of 1024 such rays: up to 0.016, and that of the transfer's own.
    assert np.sqrt(np.square(counted - visible).mean()) < 0.02 and np.abs((counted - visible).mean()) < 0.003


@pytest.mark.parametrize("name", ["noon", "sunset"])
def test_turning_the_light_is_turning_the_mesh_back(corner, albedo, name):
    def shading(mesh, light):
        return Relighter(Scene([mesh])).shading(light, albedo)

    light = Environment.load(name)
    lit, back = shading(corner, light.rotated(75.0)), shading(turned(corner, -75.0), light)
    assert lit.sun_count == back.sun_count > 0 and lit.bounces and back.bounces
    # The same suns, but other ray sets for sky and bounces: 1.6 to 2% were measured with 128 and with 512 rays.
    assert difference(back.radiance, lit.radiance) < 0.04
    assert difference(shading(turned(corner, 75.0), light).radiance, lit.radiance) > 0.5


def test_nothing_is_what_analytic_gives_to_the_bit(scene, noon, albedo):
    nothing, analytic = Relighter(scene, effects="none"), Relighter(scene, "analytic")
    assert nothing.method == "analytic" and not nothing.effects and not analytic.effects
    np.testing.assert_array_equal(nothing.shade(noon, albedo), analytic.shade(noon, albedo))
    np.testing.assert_array_equal(nothing.transfer, analytic.transfer)
    assert difference(Relighter(scene, rays=64).shade(noon, albedo), nothing.shade(noon, albedo)) > 0.2


@pytest.mark.parametrize("limit", [400, 60])
def test_chunks_change_no_bit_of_direct_light_and_bounces_by_rounding(corner, albedo, noon, limit):
    whole, parts = Scene([corner]), Scene.from_mesh(corner, limit)
    assert len(parts.chunks) > 1
    place = {row.tobytes(): index for index, row in enumerate(np.hstack([corner.vertices, corner.normals]))}
    rows = [place[row.tobytes()] for row in np.hstack([parts.vertices, parts.normals])]
    direct = Relighter(whole, rays=32, effects="shadows,sun").shade(noon, albedo)
    chunked = Relighter(parts, rays=32, effects="shadows,sun").shade(noon, albedo[rows])
    np.testing.assert_array_equal(chunked, direct[rows])
    # Light bounced off a seam comes from either of its vertices: other sums of the same numbers. How many bounces
    # there are depends on a mean over vertices, in which a seam counts more: at most one more, of 1e-3.
    one, other = Relighter(whole, rays=32).shading(noon, albedo), Relighter(parts, rays=32).shading(noon, albedo[rows])
    assert difference(other.radiance, one.radiance[rows]) < 1e-6 + 1e-3 * (len(one.bounces) != len(other.bounces))


# -- how light and albedo act


def test_twice_the_light_is_twice_the_radiance_to_the_bit(scene, noon, albedo):
    relighter, twice = Relighter(scene, rays=32), Environment(2 * noon.radiance, "twice", noon.rotation_deg)
    once, double = relighter.shading(noon, albedo), relighter.shading(twice, albedo)
    assert once.sun_count > 0 and (double.sun_count, double.bounces) == (once.sun_count, once.bounces)
    np.testing.assert_array_equal(double.radiance, 2 * once.radiance)


def test_lights_add_up(scene, soft, albedo):
    """With all that has no threshold in it: split and end of the bounces look at the light."""
    other = Environment(np.flip(soft.radiance, axis=1), "other")
    both = Environment(soft.radiance + other.radiance, "both")
    relighter = Relighter(scene, rays=64, effects="shadows")
    one, two = (relighter.shade(light, albedo) for light in (soft, other))
    bright = np.minimum(one, two) > 1e-3  # in the dark ringing below 0 is cut off for each light by itself
    assert bright.mean() > 0.9
    # Float32 sums of 100 products
    np.testing.assert_allclose(relighter.shade(both, albedo)[bright], (one + two)[bright], rtol=1e-5, atol=1e-6)


def test_light_without_bounces_is_proportional_to_the_albedo_and_with_them_more_than_that(scene, noon, albedo):
    plain = Relighter(scene, rays=32, effects="shadows,sun")
    np.testing.assert_array_equal(plain.shade(noon, albedo / 2), plain.shade(noon, albedo) / 2)
    np.testing.assert_array_equal(plain.shade(noon, albedo), plain.shade(noon) * albedo)
    bouncing = Relighter(scene, rays=32)
    grey, dark = bouncing.shade(noon, albedo), bouncing.shade(noon, albedo / 2)
    assert (grey >= plain.shade(noon, albedo)).all()  # nothing that bounces takes light away
    assert (dark <= grey / 2).all() and np.linalg.norm(dark) < 0.49 * np.linalg.norm(grey)
    np.testing.assert_array_equal(bouncing.shade(noon, 0 * albedo), 0.0)


# -- which effects act


@pytest.mark.parametrize("effects", ["auto", " auto", ["auto"]])
def test_auto_bounces_light_where_it_fades(scene, noon, effects):
    relighter, white = Relighter(scene, rays=32, effects=effects), np.ones(scene.vertices.shape, np.float32)
    assert relighter.method == "raytraced" and relighter.effects == set(EFFECTS)
    assert relighter.shading(noon).bounces == relighter.shading(noon, white).bounces == []
    np.testing.assert_array_equal(relighter.shade(noon), relighter.shade(noon, white))
    grey = relighter.shading(noon, white / 2).bounces
    assert grey and grey == sorted(grey, reverse=True) and grey[0] > 0.02 and grey[-1] < 2e-3


def test_bounces_asked_for_bounce_on_white_and_lose_nothing(scene):
    """The white furnace: in a constant sky all that surfaces hide of it they make up for."""
    relighter = Relighter(scene, effects="shadows,bounces")
    shading = relighter.shading(constant([1, 2, 3]))
    assert visible_fraction(relighter.transfer).min() < 0.1
    # What the bounces beyond the tolerance of 1e-3 leave, most of it in the corner: 4e-3 was measured.
    np.testing.assert_allclose(shading.radiance, np.tile([1.0, 2.0, 3.0], (len(shading.radiance), 1)), rtol=8e-3)
    assert len(shading.bounces) > 5


def test_geometry_is_traced_once_for_all_lights_angles_and_albedos(scene, noon, soft, albedo, monkeypatch):
    calls = []

    def counted(module, name):
        function = getattr(module, name)
        monkeypatch.setattr(module, name, lambda *args, **kw: [calls.append(name), function(*args, **kw)][1])

    counted(kept_bounces, "Occluder")
    counted(precomputed, "Visibility")
    counted(bounce_places.BouncePlaces, "shot")
    relighter = Relighter(scene, rays=8)
    assert calls == []
    relighter.shade(noon)
    assert calls == ["Occluder", "Visibility"]
    for light in (noon, noon.rotated(50.0), soft):
        for surface in (None, albedo, albedo / 3):
            relighter.shade(light, surface)
    assert calls == ["Occluder", "Visibility", "shot"]
    Relighter(scene, effects="none").shade(noon, albedo)
    assert len(calls) == 3


@pytest.mark.parametrize("rays", [1, 2, 3, 8])
def test_few_rays_are_enough_for_bounces(scene, noon, albedo, rays):
    """With two rays the filtered visible fraction leaves [0, 1] by 0.16 in this scene."""
    shading = Relighter(scene, rays=rays, bands=3).shading(noon, albedo)
    many = Relighter(scene, bands=3).shading(noon, albedo)
    # Noise: 3 to 6% were measured.
    assert shading.bounces and difference(shading.radiance, many.radiance) < 0.1


WRONG = [
    ("auto", "shine", "'shine': expected auto or none alone, or some of shadows sun bounces"),
    ("auto", "shadows,sun,shine", "expected auto or none alone"),
    ("auto", "auto,sun", "expected auto or none alone"),
    ("auto", "none,sun", "expected auto or none alone"),
    ("auto", "", "expected auto or none alone"),
    ("auto", "Shadows", "expected auto or none alone"),
    ("auto", "sun", "sun: sun, bounces and volume need shadows too"),
    ("raytraced", "bounces,sun", "bounces sun: sun, bounces and volume need shadows too"),
    ("raytraced", "none", "has shadows at least"),
    ("analytic", "shadows", "the method analytic has none"),
    ("neural-gash", "shadows,sun", "the method neural-gash has none"),
]


@pytest.mark.parametrize(("method", "effects", "message"), WRONG)
def test_effects_that_make_no_sense_are_refused(scene, tmp_path, capsys, method, effects, message):
    with pytest.raises(InputError, match=message):
        Relighter(scene, method, effects=effects)
    scene.save(tmp_path / "scene")
    before = sorted(tmp_path.rglob("*"))
    assert cli.main([str(tmp_path / "scene"), "--method", method, "--effects", effects]) == 2
    printed = capsys.readouterr()
    assert printed.out == "" and printed.err.count("\n") == 1
    assert printed.err.startswith("error: ") and message in printed.err
    assert sorted(tmp_path.rglob("*")) == before


@pytest.mark.parametrize("method", ["auto", "analytic"])
@pytest.mark.parametrize("value", [-0.1, 1.5, np.nan])
def test_an_albedo_beyond_its_range_is_refused_by_every_method(scene, soft, albedo, method, value):
    wrong = albedo.copy()
    wrong[7, 1] = value
    with pytest.raises(InputError, match=r"albedo must be in \[0, 1\]"):
        Relighter(scene, method).shade(soft, wrong)


# -- the command


@pytest.fixture
def folder(scene, tmp_path):
    scene.save(tmp_path / "scene")
    return tmp_path / "scene"


def relight(folder, output, *options):
    """Radiance and report of the command, run with few rays."""
    arguments = [folder, "-o", output, "--rays", "16", "--albedo", "captured", "--format", "npy", "-q", *options]
    assert cli.main(list(map(str, arguments))) == 0
    text = (output / "report.json").read_text(encoding="utf-8")
    # json writes NaN and infinity as words that no other reader knows.
    return np.load(output / "radiance.npy"), json.loads(text, parse_constant=lambda word: pytest.fail(word))


@pytest.mark.parametrize(
    ("options", "method", "effects", "suns", "bounces"),
    [
        ((), "raytraced", ["bounces", "shadows", "sun"], True, True),
        (("--albedo", "white"), "raytraced", ["shadows", "sun"], True, False),
        (("--effects", "shadows,sun,bounces", "--bands", "3"), "raytraced", ["bounces", "shadows", "sun"], True, True),
        (("--albedo", "white", "--effects", "bounces,shadows"), "raytraced", ["bounces", "shadows"], False, True),
        (("--effects", "shadows sun"), "raytraced", ["shadows", "sun"], True, False),
        (("--effects", "none"), "analytic", [], False, False),
        (("--method", "analytic"), "analytic", [], False, False),
    ],
)
def test_the_report_lists_effects_suns_and_bounces(folder, tmp_path, options, method, effects, suns, bounces):
    radiance, report = relight(folder, tmp_path / "out", "--env", "noon", *options)
    assert (report["method"], report["effects"]) == (method, effects)
    assert type(report["suns"]) is int and (report["suns"] > 0) == suns
    assert all(type(share) is float and 0 < share < 1 for share in report["bounces"])
    assert (len(report["bounces"]) > 0) == bounces
    assert report["rays"] == (16 if effects else 0)
    assert ("sunlight" in report["seconds"], "bounces" in report["seconds"]) == (suns, bounces)
    assert np.isfinite(radiance).all() and radiance.min() >= 0 and radiance.max() > 0


def test_no_effects_and_analytic_write_equal_bytes(folder, tmp_path):
    relight(folder, tmp_path / "a", "--env", "sunset", "--effects", "none")
    relight(folder, tmp_path / "b", "--env", "sunset", "--method", "analytic")
    assert (tmp_path / "a" / "radiance.npy").read_bytes() == (tmp_path / "b" / "radiance.npy").read_bytes()


def test_two_angles_at_once_write_the_bytes_of_two_runs(folder, tmp_path):
    both = ["--env", "noon", "--rotate", "30:100:70"]
    few = "--rays", 16, "--albedo", "captured", "--format", "npy", "-q"
    assert cli.main([*map(str, (folder, "-o", tmp_path / "both", *few)), *both]) == 0
    for angle in ("30", "100"):
        _, alone = relight(folder, tmp_path / angle, "--env", "noon", "--rotate", angle)
        together = json.loads((tmp_path / "both" / f"noon_{angle}" / "report.json").read_text(encoding="utf-8"))
        written = (tmp_path / "both" / f"noon_{angle}" / "radiance.npy").read_bytes()
        assert written == (tmp_path / angle / "radiance.npy").read_bytes()
        assert alone["bounces"] and alone["suns"] > 0
        for key in ("effects", "suns", "bounces", "angle_deg"):
            assert together[key] == alone[key]
