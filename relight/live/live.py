"""A scene's splats, ready for any light: compressed responses, surfaces, and the initial lights."""

import warnings
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from splat2mesh.base.arrays import Faces, Floats, Indices, Matrix4, Points, Radiance
from splat2mesh.base.errors import DataWarning, InputError
from splat2mesh.scene.color import luminance
from splat2mesh.scene.scene import Scene
from splat2mesh.splats.splats import SH_C0, Splats
from splat2mesh.surface.decimate import decimate

from ..light.environment import Environment
from ..splats.binding import Binding
from ..splats.light_ratio import CURVE_OFFSET, CURVE_POWER
from ..splats.mirrored_places import Mix
from ..splats.sky import shown_as_sky
from .basis import Basis, Packed, packed, reduced, usual_moment
from .compression import Compressed, choices_for, cluster_centers, compress
from .ground import ShadowedGround
from .harmonics import turned
from .lights import PortableLight, capture_light, light_of
from .objects import LiveObjects
from .offered import OfferedLight
from .response import BANDS, COEFFICIENTS, LAMPS, SPREAD_BANDS, Response, assumed_response, light_vector, response_of
from .shine import BundleRows, Shine, shine_of
from .surface import LIT, SKY, UNLIT, Surfaces, surfaces
from .terms import Source, Term, term_of

if TYPE_CHECKING:
    from ..engine.appearance import Appearance
    from ..engine.relighter import Relighter
    from ..engine.relit_room import RelitRoom
    from ..gloss.material import Gloss
    from ..splats.floor_mirror import FloorMirror
    from ..transfer.settings import Settings

BYTES_TOLERANCE = 0.03
"""Default relative error of the light that the bytes may add: 1.3% of a display value."""

PROXY_VERTICES = 50_000
"""Triangles of the mesh that occludes suns, blocks a walker and receives shadows: 1.8 MB."""

HOPELESS = 2.0
"""Factor on the tolerance above which more clusters cannot help: sixteen times as many halve the error."""

ANGLES_DEG = (0.0, 90.0, 180.0, 270.0)
"""Angles of the lights under which the error of the bytes is measured."""

FIRST_FOV_DEG = 60.0
"""Field of view along the longer side of the window, for objects."""

SOLID, LEAST_SOLID = 0.3, 100
"""Opacity of the splats that bound an object, and their least number; with fewer, its mesh bounds it."""

STRAY_PERCENTILES, BOX_MARGIN = (0.5, 99.5), 0.02
"""Splats beyond these percentiles along an axis are strays; the margin of the box, in diagonals."""

_BATCH = 1 << 16


class Live(NamedTuple):
    """splats: Splats, in the order of the bundle. order: (N,) their rows in the source. transfer: (N, 2 + W) uint8.
    basis: Packed. surfaces: Surfaces. lights: list of PortableLight. mean: of Response.
    proxy: (vertices, faces) in the scene frame. frame: (4, 4) scene_from_splat. errors: dict of bytes per splat and
    relative error of the choices tried. brightness: of the capture, None where unknown. middle: (3,)
    viewpoint of the sky, splat frame. source: dict of file and sha256. camera: dict of position, target, fov in
    degrees, the first view, scene frame; for an object also bounds, the box of the capture, which the page fits into
    its window. lamps: factor on the lamps of a room, or None. terms: list of Term. gloss: Shine of the glossy splats,
    or None. objects: inserted objects, or None. ground: under an object, or None. offered: likely lights of the
    capture, that a hand may set.
    """

    splats: Splats
    order: Indices
    transfer: NDArray[np.uint8]
    basis: Packed
    surfaces: Surfaces
    lights: list[PortableLight]
    mean: NDArray[np.float64]
    proxy: tuple[NDArray[np.float32], Faces]
    frame: Matrix4
    errors: list[dict[str, float]]
    brightness: float | None
    middle: NDArray[np.float64]
    source: dict[str, str]
    camera: dict[str, Any]
    lamps: float | None = None
    terms: Sequence[Term] = ()
    gloss: Shine | None = None
    objects: LiveObjects | None = None
    ground: ShadowedGround | None = None
    offered: Sequence[OfferedLight] = ()


@dataclass(frozen=True, eq=False)
class LiveScene:
    """The input of a Live.

    relighter, appearance: of the scene. splats: its source. room: its RelitRoom, or None. sources: light beside the
    environments; each becomes a Term. gloss: its glossy surfaces, or None. assumed: whether environments change the
    room by an assumption. mirror: floor of the scene that mirrors in the splats, or None.
    """

    relighter: "Relighter"
    appearance: "Appearance"
    splats: Splats
    room: "RelitRoom | None" = None
    sources: Sequence[Source] = ()
    gloss: "Gloss | None" = None
    assumed: bool = False
    mirror: "FloorMirror | None" = None


def live_of(
    shown: LiveScene,
    environments: Sequence[tuple[Environment, float] | tuple[Environment, float, float]],
    settings: "Settings",
    tolerance: float | None = None,
    sky: str = "new",
    seed: int = 0,
) -> Live:
    """The Live of a scene.

    environments: list of (Environment, display value per radiance) and, in rooms, the factor on their lamps. settings:
    Settings whose rays and bounces apply, in 10 bands. tolerance: relative error that the bytes may add. sky: of
    `splats.SKIES`. Raises InputError without splats to light.
    """
    relighter, appearance, splats = shown.relighter, shown.appearance, shown.splats
    room, sources, scene, assumed = shown.room, shown.sources, shown.relighter.scene, shown.assumed
    lit = relighter if room is None else room.lit
    lamps = room.lamp_factor if room is not None and room.lamps_found else None
    if sources and room is not None and not room.lets_in and not assumed:
        lamps = None  # they are part of the captured light, to which no environment adds
    if not len(splats):
        raise InputError("there are no splats to light")
    kinds = np.full(len(splats), LIT, np.uint8)
    order = _spatial_order(splats)
    binding = Binding(splats, scene, views=(), seed=seed).mirroring(shown.mirror, scene)
    kinds[~binding.lit] = UNLIT
    if appearance.as_captured and not sources and not assumed:
        kinds[:] = UNLIT
    if sky != "keep":
        kinds[shown_as_sky(splats, scene, appearance, shown.mirror)] = SKY
    shares = (binding.surface.areas / np.bincount(binding.surface.node))[binding.surface.node]
    with relighter.stages.stage("response"):
        known = room if room is not None and appearance.room is not None and not appearance.as_captured else None
        if assumed and room is not None:
            response = assumed_response(appearance, shares, room)
        elif appearance.as_captured and sources:
            response = _unchanged(len(shares))
        else:
            response = response_of(lit, appearance, settings._replace(bands=BANDS), shares, known)
        lights = [light_of(*each) for each in environments]
        if not sources:  # which have the captured light itself
            captured = capture_light(response, np.maximum(shares, 1e-12 * shares.max()), lamps or 0.0)
            lights += [captured] if captured is not None and not appearance.as_captured else []
        vectors = _turned_vectors(lights)
        truth = np.einsum("vkc,tkc->vtc", response.values, vectors, optimize=True)
    with relighter.stages.stage("spread"):
        brightness = 1.0 if appearance.capture is None else float(appearance.capture["brightness"])
        even = np.sqrt(4.0 * np.pi) * (response.values[:, 0] + response.values[:, BANDS**2])  # under a constant sky
        even = np.maximum(brightness * even + response.values[:, LAMPS], np.float32(1e-3))
        counts: Floats = shares * _visible_error(even, appearance.captured)
        moment = usual_moment(brightness)
        rows, basis = reduced(response.values, counts, moment)
        rows, counts = _rows_and_counts(binding, rows, even, splats, basis.by_color(moment))
        every = slice(None, None, -(-len(rows) // _BATCH))
        truth = np.stack([binding.spread(each)[every] for each in np.moveaxis(truth, 1, 0)], axis=1)
    with relighter.stages.stage("compress"):
        allowed = BYTES_TOLERANCE if tolerance is None else tolerance
        found, errors = _compressed(rows, counts, basis, vectors, truth, every, allowed, seed)
    with relighter.stages.stage("surface"):
        foliage = lit.precomputed.foliage if settings.volume else None
        surface = surfaces(binding, splats.means, scene, response.own, kinds, foliage)
        vertices, faces = decimate(lit.scene.vertices.astype(np.float64), lit.scene.faces, PROXY_VERTICES)
    transfer = np.zeros((len(splats), 2 + found.weights.shape[1]), np.uint8)

    def of_splats(values: NDArray[np.float32]) -> NDArray[np.float32]:
        spread = np.zeros((len(splats), 3), np.float32)
        spread[binding.lit] = np.maximum(binding.spread(values), 0.0)
        spread[kinds != LIT] = 0.0
        return spread[order]

    before = appearance.captured, appearance.irradiance
    terms = [term_of(each, *before, shares, of_splats) for each in sources]
    bytes_ = np.concatenate([found.cluster.astype("<u2")[:, None].view(np.uint8), found.weights.view(np.uint8)], axis=1)
    transfer[binding.lit] = bytes_
    capture = appearance.capture
    near = splats.means[binding.lit & (kinds != SKY)]
    return Live(
        splats=splats.take(order),
        order=order,
        transfer=transfer[order],
        basis=packed(basis, found),
        surfaces=surface._replace(packed=surface.packed[order]),
        lights=lights,
        mean=response.mean,
        proxy=(vertices.astype(np.float32), faces),
        frame=np.asarray(scene.scene_from_splat, np.float64),
        errors=errors,
        brightness=None if capture is None else float(capture["brightness"]),
        middle=np.median(near, axis=0).astype(np.float64) if len(near) else np.zeros(3),
        source={name: scene.source[name] for name in ("file", "sha256") if name in scene.source},
        camera=_first_view(scene, splats, vertices),
        lamps=lamps,
        terms=terms,
        gloss=_shine(binding, shown, kinds == LIT, order),
    )


def _shine(binding: Binding, shown: LiveScene, lit: NDArray[np.bool_], order: Indices) -> Shine | None:
    """The Shine of the glossy splats, or None."""
    gloss, look = shown.gloss, shown.appearance
    if gloss is None or look.environment is None:
        return None
    matrix = np.asarray(shown.relighter.scene.scene_from_splat, np.float64)
    lamps = [(number, *each.shines) for number, each in enumerate(shown.sources) if each.shines is not None]
    return shine_of(binding, gloss, look.environment.sh(BANDS), look.captured, BundleRows(matrix, lit, order, lamps))


def _unchanged(count: int) -> Response:
    """The Response of vertices that no environment changes."""
    nothing = np.zeros((count, 3), np.float32)
    return Response(np.zeros((count, COEFFICIENTS, 3), np.float32), nothing, np.zeros((SPREAD_BANDS**2 + 1, 3)))


def _rows_and_counts(
    binding: Binding, rows: NDArray[np.float32], even: NDArray[np.float32], splats: Splats, mix: Mix
) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """Rows (N, D) float32 of the lit splats from those of the vertices, and the visual weight of their errors, (N,).

    even: (V, 3) light ratio under a constant sky. mix: of rows.
    """
    parts = 4 if binding.mirrored is None else 1  # to save memory; colours of a row are in all of it
    rows = np.concatenate([binding.spread(part, mix) for part in np.array_split(rows, parts, axis=1)], axis=1)
    lit = splats if binding.lit.all() else splats.take(binding.lit)
    color = np.clip(SH_C0 * lit.sh[:, 0] + 0.5, 0.0, 1.0)
    return rows, _visible_error(binding.spread(even), color, lit.opacities).astype(np.float32)


def _visible_error(ratio: Radiance, color: Radiance, opacity: Floats | float = 1.0) -> Floats:
    """Weight of a squared error of the ratio, (N,)."""
    ratio = luminance(np.maximum(ratio, 1e-3))
    return opacity * ((luminance(color) + CURVE_OFFSET) * ratio ** (1.0 / CURVE_POWER - 1.0)) ** 2


def _turned_vectors(lights: Sequence[PortableLight]) -> NDArray[np.float32]:
    """The vectors of lights at ANGLES_DEG, (T, COEFFICIENTS, 3) float32."""
    vectors = []
    for light in lights:
        for angle in ANGLES_DEG:
            rest, whole = (light.exposure * turned(each, angle) for each in (light.rest, light.whole))
            vectors.append(light_vector(rest, whole, light.lamps))
    return np.stack(vectors).astype(np.float32)


def _compressed(
    rows: NDArray[np.float32],
    counts: Floats,
    basis: Basis,
    vectors: NDArray[np.float32],
    truth: Floats,
    every: slice,
    tolerance: float,
    seed: int,
) -> tuple[Compressed, list[dict[str, float]]]:
    """The first of `choices_for` the rows within the tolerance, else the best; and a list of dicts with the bytes and
    error of each choice tried. truth: (S, T, 3), light ratio of one row in `every` under lights of vectors (T, K, 3).
    """
    base, small = basis.colors(vectors)
    size = np.sqrt(np.square(truth).mean(axis=(0, 2)))
    tried: list[dict[str, float]] = []
    best: tuple[float, Compressed] | None = None
    centers: dict[int, NDArray[np.float32]] = {}
    hopeless: set[int] = set()
    for choice in choices_for(len(rows)):
        if choice.weights in hopeless:
            continue
        if choice.clusters not in centers:
            centers[choice.clusters] = cluster_centers(rows, counts, choice.clusters, seed)
        found = compress(rows, counts, choice, seed, centers[choice.clusters])
        off = base + np.einsum("nd,dtc->ntc", found.rows(every), small, optimize=True) - truth
        error = float((np.sqrt(np.square(off).mean(axis=(0, 2))) / np.where(size > 0.0, size, 1.0)).max())
        tried.append({"bytes": choice.bytes, "clusters": len(found.means), "error": error})
        if best is None or error < best[0]:
            best = error, found
        if error <= tolerance:
            break
        if error > HOPELESS * tolerance:
            hopeless.add(choice.weights)
    else:
        assert best is not None  # there is always a choice
        warnings.warn(
            f"the largest transfer leaves an error of {best[0]:.3f}, {tolerance:g} was requested",
            DataWarning,
            stacklevel=2,
        )
    return best[1], tried


def _first_view(scene: Scene, splats: Splats, vertices: Points) -> dict[str, Any]:
    """The first view, that of the preview. An object also has `bounds`, two corners in the scene frame: the page moves
    the camera back until their box fits its window."""
    camera = scene.preview_camera
    if camera is not None and scene.capture.get("from", "outside") != "outside":
        return {"position": list(camera["eye"]), "target": list(camera["target"]), "fov": 75.0}
    low, high = _captured_box(scene, splats, vertices)
    middle, reach = (low + high) / 2, float(np.linalg.norm(high - low)) / 2
    toward = np.array([0.35, 0.4, 1.0]) if camera is None else np.subtract(camera["eye"], camera["target"])
    return {
        "position": (middle + 1.7 * reach * toward / np.linalg.norm(toward)).tolist(),
        "target": middle.tolist(),
        "fov": FIRST_FOV_DEG,
        "bounds": [low.tolist(), high.tolist()],
    }


def _captured_box(scene: Scene, splats: Splats, vertices: Points) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Lowest and highest corner (3,) of the capture, scene frame, without far background and stray splats."""
    near = (splats.opacities > SOLID) & np.isfinite(splats.means).all(axis=1)
    near[scene.background_splats] = False
    points = vertices
    if near.sum() >= LEAST_SOLID:
        matrix = np.asarray(scene.scene_from_splat, np.float64)
        points = splats.means[near] @ matrix[:3, :3].T + matrix[:3, 3]
    low, high = np.percentile(points, STRAY_PERCENTILES, axis=0)
    margin = BOX_MARGIN * float(np.linalg.norm(high - low))
    return low - margin, high + margin


def _spatial_order(splats: Splats) -> Indices:
    """Rows along a Z-order curve; those without a finite position come last."""
    finite = np.isfinite(splats.means).all(axis=1)
    rows = np.flatnonzero(finite)
    return np.concatenate([rows[splats.take(finite).spatial_order()], np.flatnonzero(~finite)])
