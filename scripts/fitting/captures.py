"""Captures of generated scenes under photographed lights, as arrays: what an estimate needs, and the truth.

A scene is meshed once, from splats laid out as training leaves them. Its splats take their true colours under each
light, exposed as a photographer would, some with a tone curve; vertices take the colours of the splats around, and
the sky is seen where the capture saw it, clipped where it is bright. So the errors of mesh, blur and clipping are those
of the pipeline, and a hundred captures take minutes, not days.
"""

from pathlib import Path

import numpy as np

from splat2mesh.base.sphere import row_solid_angles, texel_directions

PARTS = {
    "fit": {"garden": (3, 5, 8), "nook": (1, 4), "object": (1, 2, 3), "tabletop": (1, 2), "room": (1, 2)},
    "choose": {"garden": (11, 2), "street": (1,), "nook": (2, 9), "figure": (1,), "object": (4,), "tabletop": (3,)},
    "test": {"courtyard": (1,), "still-life": (1,), "machine": (1,), "forest": (1,), "white-sky": (1,), "nook": (6,)},
}
"""Kinds of scenes and their seeds. Lights are split as well, by `part_of`."""


def part_of(name):
    """The part that a light belongs to: every light has one, by its name."""
    return ("fit", "fit", "choose", "test")[sum(name.encode()) % 4]


def load(folder, part):
    """Captures of a part, dicts of arrays, in the order of their names."""
    found = []
    for kind, seeds in PARTS[part].items():
        for seed in seeds:
            for path in sorted(Path(folder).glob(f"{kind}{seed}-*.npz")):
                with np.load(path) as file:
                    found.append({name: file[name] for name in file.files} | {"scene": f"{kind}{seed}"})
    return found


SPLATS, PLACE_VERTICES, OBJECT_VERTICES = 30_000, 60_000, 25_000
"""Of each scene, and of its mesh."""

CAPTURES, RELIT = 3, 2
"""Lights of each scene, and new lights of each capture: the next two of the scene."""

TINT, EXPOSURE, CURVED = 0.08, 0.25, 0.2
"""Spread of the log tint of lights and of log exposures, and share of captures with a tone curve."""

NEAR, SEEN = 12, 800
"""Splats that give a vertex its colour; vertices at which losses are measured."""


DIRECTIONS = texel_directions(64, 128).reshape(-1, 3)


def light_maps(folder):
    """name -> radiance (64, 128, 3) of the light maps of a folder, mean luminance 1."""
    from relight import Environment
    from splat2mesh.scene.color import luminance

    found, areas = {}, row_solid_angles(64, 128)
    for path in sorted(path for path in folder.iterdir() if path.suffix.lower() in (".exr", ".hdr")):
        image = Environment.load(path).lookup(DIRECTIONS).reshape(64, 128, 3)
        found[path.stem] = image / ((luminance(image) * areas).sum() / (4.0 * np.pi))
    return found


def harmonics_of(image, bands=8):
    """(K, 3) harmonics of a light map."""
    from relight import Environment

    return Environment(np.asarray(image, np.float32), "light").sh(bands).astype(np.float32)


def make(folder, lights, parts=("fit", "choose", "test"), say=print):
    """Make the captures of parts of the corpus that are missing. lights: name -> radiance (64, 128, 3)."""
    for part in parts:
        own = {name: image for name, image in lights.items() if part_of(name) == part}
        for kind, seeds in PARTS[part].items():
            for seed in seeds:
                if not list(Path(folder).glob(f"{kind}{seed}-*.npz")):
                    for number, arrays in enumerate(captures_of(kind, seed, own)):
                        np.savez(Path(folder) / f"{kind}{seed}-cap{number}.npz", **arrays)
                    say(f"{part}: {kind} {seed}")


def around(image, directions):
    """(K, 3) mean of a light map around each of the directions, which share the sphere."""
    from scipy.spatial import cKDTree

    owner, areas = cKDTree(directions).query(DIRECTIONS)[1], np.repeat(row_solid_angles(64, 128).ravel(), 128)
    total = np.bincount(owner, areas, len(directions))
    columns = (np.bincount(owner, areas * column, len(directions)) for column in image.reshape(-1, 3).T)
    return np.stack(list(columns), axis=1) / total[:, None]


def captures_of(kind, seed, lights):
    """The captures of one scene under CAPTURES of the lights: dicts of arrays."""
    rng = np.random.default_rng([seed, *kind.encode()])
    truth, scene = meshed(kind, seed)
    shot = list(shot_under(truth, lights, CAPTURES, rng))
    return _arrays(scene, truth, shot, rng)


def meshed(kind, seed):
    """The _Truth of a scene, and the Scene of its splats under an overcast sky."""
    from tempfile import TemporaryDirectory

    from relight import Environment
    from splat2mesh import convert
    from splat2mesh.splats.formats import write_inria_ply

    truth = _truth(kind, seed)
    with TemporaryDirectory() as folder:
        path = Path(folder) / "splat.ply"
        write_inria_ply(path, truth.lit(Environment.load("overcast"), 1.0)[0])
        vertices = PLACE_VERTICES if truth.is_place else OBJECT_VERTICES
        stand = "outside" if kind in ("object", "tabletop", "figure", "machine", "still-life") else "auto"
        return truth, convert(path, detail="draft", texture="none", up="-y", vertices=vertices, stand=stand)


def shot_under(truth, lights, count, rng):
    """(name, light in captured units, splats, whether curved) of a scene under some of the lights, each turned."""
    from relight import Environment

    for name in rng.permutation(sorted(lights))[:count]:
        image = np.roll(lights[name], int(rng.integers(128)), axis=1) * np.exp(TINT * rng.standard_normal(3))
        environment = Environment(image.astype(np.float32), str(name))
        splats, exposure = truth.lit(environment, float(np.exp(EXPOSURE * rng.standard_normal())))
        yield str(name), exposure * image, splats, rng.random() < CURVED


class _Truth:
    """A generated scene whose splats can be lit: a place, or an object as a place without openings and leaves."""

    def __init__(self, place, views, attached, normals, colors):
        self.place, self.views, self._attached, self._normals, self._colors = place, views, attached, normals, colors

    @property
    def is_place(self):
        return self._attached is not None

    def lit(self, environment, factor):
        """Splats under an environment, and their exposure."""
        return self._colors(environment, factor)


def _truth(kind, seed):
    """The _Truth of a kind and seed of `scenes`."""
    from dataclasses import replace

    from scenes.cameras import capture_views, seen_faces
    from scenes.capture import LEAF, SOLID, capture
    from scenes.kinds import build
    from scenes.light import exposure
    from scenes.places import PLACES, build_place
    from scenes.places.place import Place
    from scenes.radiosity import light
    from scenes.splat import splats_from

    if kind in PLACES:
        place = build_place(kind, seed, 24_000)
        views = capture_views(place, 64)
        from relight import Environment

        made = capture(place, light(place, Environment.load("overcast")), views, SPLATS, seed)
        solid = made.region == SOLID
        normals = np.zeros((len(solid), 3))
        normals[made.faces >= 0] = place.normals[place.faces[made.faces[made.faces >= 0], 0]]

        def colors(environment, factor):
            lighting = light(place, environment)
            scale = factor * float(exposure(lighting.at(made.faces[solid], made.weights[solid])))
            return replace(made, exposure=scale).lit(lighting), scale

        return _Truth(place, views, (solid, made.region == LEAF), normals, colors)
    truth = build(kind, seed, 20_000)
    views = capture_views(truth, 64)
    faces = seen_faces(truth, views)
    count, seen = len(truth.vertices), np.unique(truth.faces[faces])
    fields = {
        name: getattr(truth, name) for name in ("kind", "seed", "vertices", "normals", "faces", "albedo_linear", "part")
    }
    dark, nowhere = np.zeros((count, 3), np.float32), np.zeros(count, bool)
    beyond = {"emitted": dark, "volume": nowhere, "leaf_start": count, "transmittance": 0.0, "openings": None}
    place = Place(**fields, **beyond, paints=(None,) * (int(truth.part.max()) + 1), walk=None)

    def colors(environment, factor):
        radiance = light(place, environment).radiance()
        scale = factor * float(exposure(radiance[seen]))
        return splats_from(truth, scale * radiance, SPLATS, seed, faces), scale

    return _Truth(place, views, None, None, colors)


def _arrays(scene, truth, shot, rng):
    """The arrays of every capture of a scene; shot: (name, light in captured units, splats, whether curved) of each."""
    from relight.albedo import samples
    from relight.albedo.captured import CapturedScene, CaptureEvidence
    from relight.albedo.seen import looks_from
    from relight.albedo.skylight import seen_sky
    from relight.engine.appearance import CAPTURE
    from relight.engine.relighter import Relighter
    from splat2mesh.scene.color import linear_from_srgb
    from splat2mesh.splats.splats import SH_C0

    relighter = Relighter(scene)
    known = relighter.transport(CAPTURE, alone=True)
    occluder, looks = relighter.occluder, looks_from(scene, relighter.occluder)
    index, weight, front = splats_around(scene, truth, shot[0][2])
    areas = samples.vertex_areas(occluder) if looks is None else looks.sizes(len(occluder.origins))
    rows = samples.places(occluder, areas, (areas > 0) & front, 2500, 7)[:SEEN]
    sky = None if scene.measured is None else scene.measured.sky
    looked = None if sky is None else (sky.bound + sky.clipped).mean(axis=2)[..., None]
    colors = [np.clip(splats.sh[:, 0] * SH_C0 + 0.5, 0.0, 1.0) for _, _, splats, _ in shot]
    for number, (name, image, _, curved) in enumerate(shot):
        captured = _curved(linear_from_srgb((weight * colors[number][index]).sum(axis=1).astype(np.float32)), curved)
        seen = None
        if looked is not None:
            seen = photographed(image, looked, rng, curved)
        day = CapturedScene(occluder, captured, 0, lambda count: None, known, CaptureEvidence(seen, looks))
        places = day.evidence.places
        found = {**places._asdict(), "name": name, "light": harmonics_of(image)}
        if day.sky is not None:
            cells = seen_sky(day.sky, places.directions)
            found |= {"sky_log": cells.log_radiance, "sky_seen": cells.seen, "sky_clipped": cells.clipped}
        others = [colors[(number + step) % len(shot)][index[rows]] for step in range(1, RELIT + 1)]
        found["relit"] = np.stack(
            [linear_from_srgb((weight[rows] * each).sum(axis=1).astype(np.float32)) for each in others]
        )
        found |= {"seen_transfer": known.transfer[rows], "seen_bounced": day.bounce[rows]}
        yield found


def splats_around(scene, truth, splats):
    """Splats around each vertex (V, NEAR), their weights (V, NEAR, 1), and whether its side was seen (V,)."""
    from scipy.spatial import cKDTree

    matrix = np.asarray(scene.scene_from_splat)
    means = splats.means @ matrix[:3, :3].T + matrix[:3, 3]
    solid, leaf = truth._attached if truth.is_place else (np.ones(len(means), bool), np.zeros(len(means), bool))
    rows = np.flatnonzero(solid | leaf)
    distance, index = cKDTree(means[rows]).query(scene.vertices, NEAR)
    index, near = rows[index], np.median(distance[:, 5]) + distance[:, 3:4]
    weight = np.exp(-0.5 * (distance / (0.6 * near)) ** 2) * splats.opacities[index]
    normals = truth._normals
    if normals is None:
        normals = truth.place.normals[cKDTree(truth.place.vertices).query(means)[1]]
    front = np.einsum("vkc,vc->vk", normals[index[:, :4]], scene.normals) > 0.2
    front = (front | leaf[index[:, :4]]).mean(axis=1) >= 0.5
    front &= distance[:, 3] < 4.0 * np.median(distance[:, 3])
    return index, (weight / np.maximum(weight.sum(axis=1, keepdims=True), 1e-9))[..., None], front


def _curved(linear, curved):
    """Linear colour as a camera's shoulder shows it from half of white on."""
    soft = 0.5 + 0.5 * (1.0 - np.exp(-(linear - 0.5) / 0.5))
    return np.where(linear < 0.5, linear, soft).astype(linear.dtype) if curved else linear


def photographed(image, looked, rng, curved):
    """The CapturedSky of a light map: clipped where it is bright, seen in parts (H, W, 1)."""
    from splat2mesh.scene.color import linear_from_srgb
    from splat2mesh.scene.measured import CapturedSky

    shown = _curved(image, curved) * np.exp(0.03 * rng.standard_normal(image.shape))
    clip = shown > linear_from_srgb(np.float32(0.97))
    parts = np.where(clip, 0.0, shown), looked * ~clip, looked * clip
    return CapturedSky(*(part.astype(np.float32) for part in parts))
