"""A scene's splats, ready for any light: compressed responses, surfaces, and the initial lights."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from splat2mesh.base.arrays import Faces, Floats, Indices, Points
from splat2mesh.base.choices import DEFAULT_VERTICES
from splat2mesh.base.errors import InputError
from splat2mesh.scene.scene import Scene
from splat2mesh.splats.splats import SOLID, Splats
from splat2mesh.surface.decimate import decimate
from splat2mesh.views.viewpoints import FEW, box_of

from ..options import PLACE_TOLERANCE
from ..splats.binding import Binding
from ..splats.sky import shown_as_sky
from .basis import Packed, lit_rows, packed
from .compression import Compressed
from .ground import ShadowedGround
from .lights import OfferedLight, PortableLight, capture_light
from .objects import LiveObjects
from .parts import LiveParts
from .response import BANDS, COEFFICIENTS, SPREAD_BANDS, Response, assumed_response, response_of
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

FIRST_FOV_DEG = 60.0
"""Field of view along the longer side of the window, for objects."""


class Live(NamedTuple):
    """splats: Splats, in the order of the bundle. order: (N,) their rows in the source. transfer: (N, 2 + W) uint8.
    basis: Packed. surfaces: Surfaces. lights: list of PortableLight. proxy: (vertices, faces) in the scene frame.
    errors: dict of bytes per splat and relative error of the choices tried. facts: entries of live.json as they are
    (docs/live.md): source, frame, camera, mean, brightness, lamps. terms: list of Term. gloss: Shine of the glossy
    splats, or None. objects: inserted objects, or None. ground: under an object, or None. offered: likely lights of the
    capture, that a hand may set. parts: what is lit apart, or None.
    """

    splats: Splats
    order: Indices
    transfer: NDArray[np.uint8]
    basis: Packed
    surfaces: Surfaces
    lights: list[PortableLight]
    proxy: tuple[NDArray[np.float32], Faces]
    errors: list[dict[str, float]]
    facts: dict[str, Any]
    terms: Sequence[Term] = ()
    gloss: Shine | None = None
    objects: LiveObjects | None = None
    ground: ShadowedGround | None = None
    offered: Sequence[OfferedLight] = ()
    parts: LiveParts | None = None


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

    @property
    def lamps(self) -> float | None:
        """The factor on the lamps of a room; None without any, and where they are part of the captured light, to which
        no environment adds."""
        room = self.room
        if room is None or not room.lamps_found or (self.sources and not room.lets_in and not self.assumed):
            return None
        return room.lamp_factor


def live_of(
    shown: LiveScene,
    lights: Sequence[PortableLight],
    settings: "Settings",
    tolerance: float = PLACE_TOLERANCE,
    sky: str = "new",
    seed: int = 0,
) -> Live:
    """The Live of a scene.

    lights: of environments; the captured one joins them. settings: Settings whose rays and bounces apply, in 10 bands.
    tolerance: relative error of the light that the bytes may add: .03 is 1.3% of a display value. sky: of
    `splats.SKIES`. seed: of all that is sampled. Raises InputError without splats to light.
    """
    splats, scene, stages = shown.splats, shown.relighter.scene, shown.relighter.stages
    capture = shown.appearance.capture
    if not len(splats):
        raise InputError("there are no splats to light")
    order = spatial_order(splats)
    binding = Binding(splats, scene, views=(), seed=seed).mirroring(shown.mirror, scene)
    kinds = _kinds(shown, binding, sky)
    shares = (binding.surface.areas / np.bincount(binding.surface.node))[binding.surface.node]
    with stages.stage("response"):
        response = _response(shown, settings, shares)
        lights, captured = list(lights), None
        if not shown.sources and not shown.appearance.as_captured:  # else a term is that light
            captured = capture_light(response, np.maximum(shares, 1e-12 * shares.max()), shown.lamps or 0.0)
        lights += [] if captured is None else [captured]
    with stages.stage("spread"):
        rows = lit_rows(binding, response, splats, shown.appearance, shares, lights)
    with stages.stage("compress"):
        found, errors = rows.compressed(tolerance, seed)
    with stages.stage("surface"):
        foliage = shown.relighter.precomputed.foliage if settings.volume else None
        surface = surfaces(binding, splats.means, scene, response.own, kinds, foliage)
        vertices, faces = decimate(scene.vertices.astype(np.float64), scene.faces, DEFAULT_VERTICES)
    near, frame = splats.means[binding.lit & (kinds != SKY)], np.asarray(scene.scene_from_splat, np.float64)
    middle = np.median(near, axis=0).astype(np.float64) if len(near) else np.zeros(3)  # viewpoint of the sky
    facts = {
        "source": {name: scene.source[name] for name in ("file", "sha256") if name in scene.source},
        "frame": {"scene_from_splat": frame.tolist(), "up": "+y", "middle": middle.tolist()},
        "camera": first_view(scene, splats, vertices),
        "mean": response.mean.tolist(),
        "brightness": None if capture is None else float(capture["brightness"]),
        "lamps": shown.lamps,
    }
    return Live(
        splats=splats.take(order),
        order=order,
        transfer=_bytes(found, binding.lit)[order],
        basis=packed(rows.basis, found),
        surfaces=surface._replace(packed=surface.packed[order]),
        lights=lights,
        proxy=(vertices.astype(np.float32), faces),
        errors=errors,
        facts=facts,
        terms=_terms(shown, binding, shares, kinds, order),
        gloss=_shine(binding, shown, kinds == LIT, order),
    )


def _kinds(shown: LiveScene, binding: Binding, sky: str) -> NDArray[np.uint8]:
    """The kind of each splat, (N,)."""
    look = shown.appearance
    kinds = np.full(len(shown.splats), LIT, np.uint8)
    kinds[~binding.lit] = UNLIT
    if look.as_captured and not shown.sources and not shown.assumed:
        kinds[:] = UNLIT
    if sky != "keep":
        kinds[shown_as_sky(shown.splats, shown.relighter.scene, look, shown.mirror)] = SKY
    return kinds


def _response(shown: LiveScene, settings: "Settings", shares: Floats) -> Response:
    look, room = shown.appearance, shown.room
    if shown.assumed and room is not None:
        return assumed_response(look, shares, room)
    if look.as_captured and shown.sources:
        values = np.zeros((len(shares), COEFFICIENTS, 3), np.float32)
        return Response(values, values[:, 0], np.zeros((SPREAD_BANDS**2 + 1, 3)))
    known = room if look.room is not None and not look.as_captured else None
    return response_of(shown.relighter, look, settings._replace(bands=BANDS), shares, known)


def _terms(shown: LiveScene, binding: Binding, shares: Floats, kinds: NDArray[np.uint8], order: Indices) -> list[Term]:
    def of_splats(values: NDArray[np.float32]) -> NDArray[np.float32]:
        spread = np.zeros((len(kinds), 3), np.float32)
        spread[binding.lit] = np.maximum(binding.spread(values), 0.0)
        spread[kinds != LIT] = 0.0
        return spread[order]

    before = shown.appearance.captured, shown.appearance.irradiance
    return [term_of(each, *before, shares, of_splats) for each in shown.sources]


def _bytes(found: Compressed, lit: NDArray[np.bool_]) -> NDArray[np.uint8]:
    """Cluster and weights of each splat, (N, 2 + W) uint8, 0 where it is not lit."""
    transfer = np.zeros((len(lit), 2 + found.weights.shape[1]), np.uint8)
    cluster = found.cluster.astype("<u2")[:, None].view(np.uint8)
    transfer[lit] = np.concatenate([cluster, found.weights.view(np.uint8)], axis=1)
    return transfer


def _shine(binding: Binding, shown: LiveScene, lit: NDArray[np.bool_], order: Indices) -> Shine | None:
    """The Shine of the glossy splats, or None."""
    gloss, look = shown.gloss, shown.appearance
    if gloss is None or look.environment is None:
        return None
    matrix = np.asarray(shown.relighter.scene.scene_from_splat, np.float64)
    lamps = [(number, *each.shines) for number, each in enumerate(shown.sources) if each.shines is not None]
    return shine_of(binding, gloss, look.environment.sh(BANDS), look.captured, BundleRows(matrix, lit, order, lamps))


def first_view(scene: Scene, splats: Splats, vertices: Points) -> dict[str, Any]:
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


def _captured_box(scene: Scene, splats: Splats, vertices: Points) -> NDArray[np.float64]:
    """Lowest and highest corner (2, 3) of the capture, scene frame, without far background and stray splats."""
    near = (splats.opacities > SOLID) & np.isfinite(splats.means).all(axis=1)
    near[scene.background_splats] = False
    points = vertices
    if near.sum() > FEW:
        matrix = np.asarray(scene.scene_from_splat, np.float64)
        points = splats.means[near] @ matrix[:3, :3].T + matrix[:3, 3]
    return box_of(points)


def spatial_order(splats: Splats) -> Indices:
    """Rows along a Z-order curve; those without a finite position come last."""
    finite = np.isfinite(splats.means).all(axis=1)
    rows = np.flatnonzero(finite)
    return np.concatenate([rows[splats.take(finite).spatial_order()], np.flatnonzero(~finite)])
