"""The relit splats of a session: at once without the fit in views, exact when the light rests; and their pictures.

They are rasterised on the CPU, coarser while the camera moves, from cached weights while the light moves: a light moves
no splat. While the camera stands still, the splats of each pixel and their weights are computed once
(`relight.splats.blending`), and a picture in another light is a sum of colours.
"""

import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from splat2mesh.render.footprints import TILE
from splat2mesh.render.rasterize import rasterize
from splat2mesh.render.view import View
from splat2mesh.scene.scene import Scene
from splat2mesh.splats.harmonics import sh_basis_3dgs
from splat2mesh.splats.splats import Splats
from splat2mesh.views.standpoints import NEAR_DIAGONAL

from ..engine.light_mix import LightBeside, Received
from ..gloss.scene_gloss import NewLight
from ..light.environment import Environment, turned_about_y
from ..light.loading import CapturedLight
from ..output.picture import in_frame
from ..output.relit_splats import BoundSplats, SplatLight, relit
from ..splats.binding import ROUNDS
from ..splats.blending import Blending, blending_of
from ..splats.sky import FarSplats
from .bench import Answer, Bench, Check
from .camera import Orbit

if TYPE_CHECKING:
    from ..insert.inserts import InsertedLight
    from ..splats import Binding

WAITING = "binding the splats to the mesh"
"""Text of the panel until then, while the captured splats show."""


COARSE = 2
"""Screen pixels along the side of a drawn pixel while the camera moves: 91,000 splats on 1280 x 800 take 89 instead of
143 ms."""


class SplatLook(NamedTuple):
    """How splats take the light under one albedo. before: (V, 3) captured irradiance, unit of the
    captured colours. received: returns the irradiance (V, 3) of a radiance (V, 3) and an exposure. gloss: as of
    BoundSplats."""

    before: NDArray[np.float32]
    received: Received
    gloss: Callable[[Splats, NewLight], Splats] | None = None


class SplatSource(NamedTuple):
    """The splats of a scene, and the functions that relight them.

    captured: Splats, in their own frame. binding: returns their Binding. looks: name of an albedo -> SplatLook; under
    others the mesh shows. far: returns the FarSplats of the captured ones. sky_level: mean luminance at which
    they show it, in captured units, or None for the session's exposure.
    """

    captured: Splats
    binding: Callable[[], "Binding"]
    looks: Mapping[str, SplatLook]
    far: Callable[[Splats], FarSplats]
    sky_level: float | None = None


@dataclass(frozen=True, eq=False)
class SplatsUnder:
    """The light that splats are wanted in. sky: its name and angle, and whether it shows; None where no splat shows it.
    Two are equal if they are of the same objects."""

    radiance: NDArray[np.float32]
    mixture: LightBeside | None
    inserted: "InsertedLight | None"
    exposure: float
    albedo: str
    sky: tuple[str | None, float, bool] | None

    def __eq__(self, other: object) -> bool:
        return isinstance(other, SplatsUnder) and self.plain == other.plain and self.inserted is other.inserted

    @property
    def plain(self) -> tuple:
        """What it depends on besides inserted objects."""
        return id(self.radiance), id(self.mixture), self.exposure, self.albedo, self.sky


class RelitSplats(Bench[SplatsUnder | None, Splats]):
    """The splats of a SplatSource in the light of a Session. source: the SplatSource."""

    spare = 0

    def __init__(self, source: SplatSource, session: Any) -> None:
        super().__init__()
        self.source, self._session = source, session
        self.prepare()
        self._plain: tuple[SplatsUnder, Splats] | None = None  # without the effect of objects

    def _prepare(self) -> "tuple[Binding, FarSplats]":
        return self.source.binding(), self.source.far(self.source.captured)

    @property
    def message(self) -> str:
        """Why they cannot be relit, or ""."""
        return self.failure and f"the splats stay as captured: {self.failure}"

    def colored(self) -> Splats:
        """The Splats in the newest light, in order, in their own frame: captured ones before."""
        shown = None if self.failure else self.shown
        return self.source.captured if shown is None else shown.result

    def wait(self) -> None:
        """Wait until they are bound and fitted, where they can be."""
        assert self._prepared is not None
        self._prepared.exception()
        while self._session.objects_settled and not (self.settled or self.failure or self.wanted is None):
            self.poll(True)
            time.sleep(0.001)

    @property
    def wanted(self) -> SplatsUnder | None:
        """The present light; None where none can be shown."""
        session, state = self._session, self._session.state
        radiance = session.environment_radiance()
        if radiance is None or not self.ready or state.albedo not in self.source.looks:
            return None
        _, far = self.made
        sky = (session.answers.light_name, state.angle_deg, state.sky) if len(far.rows) else None
        return SplatsUnder(radiance, session.mixture, session.inserted, session.exposure(), state.albedo, sky)

    def _exactly(self, wanted: SplatsUnder | None, _: Check) -> Callable[[], Splats] | None:
        return None if wanted is None or not self._session.objects_settled else self._relighting(wanted)

    def _quickly(
        self, wanted: SplatsUnder | None, _: Answer[SplatsUnder | None, Splats] | None
    ) -> Callable[[], Splats] | None:
        """Without the fit in views, and with objects at the vertices, without edges."""
        if wanted is None:
            return None
        relight, (binding, _far) = self._relighting(wanted), self.made

        def quickly() -> Splats:
            if self._plain is None or self._plain[0].plain != wanted.plain:
                self._plain = wanted, relight(0)
            plain = self._plain[1]
            return plain if wanted.inserted is None else binding.shaded(plain, wanted.inserted.ratio)

        return quickly

    def _relighting(self, wanted: SplatsUnder) -> Callable[..., Splats]:
        """The function that relights the splats as they are wanted now: all, or with 0 rounds what is quick."""
        session, mixture, (binding, far) = self._session, wanted.mixture, self.made
        look, light, factor = self.source.looks[wanted.albedo], session.answers.light, session.sky_exposure()
        receives = look.received if mixture is None else mixture.receives(look.received)
        sky: Environment | None = CapturedLight() if mixture is not None and mixture.keeps_sky else None
        if not (session.state.sky or sky is not None):
            far = far._replace(choice="drop")
        if sky is None and wanted.sky is not None and light is not None:
            sky = Environment(light.sky, wanted.sky[0] or "").rotated(wanted.sky[1])
            if self.source.sky_level is not None:
                factor *= self.source.sky_level / (sky.mean_luminance or 1.0)
        bound, mirrored = BoundSplats(binding, look.before, far, look.gloss), self._mirrored(wanted)

        def relit_now(rounds: int = ROUNDS) -> Splats:
            under = SplatLight(receives(wanted.radiance, wanted.exposure), wanted.exposure, sky=sky, sky_factor=factor)
            if rounds:
                shining = mirrored(under.received) if look.gloss is not None and light is not None else None
                under = under._replace(mirrored=shining, inserted=wanted.inserted)
            return relit(bound, under, rounds)

        return relit_now

    def _mirrored(self, wanted: SplatsUnder) -> Callable[[NDArray[np.floating]], NewLight]:
        """The function for what glossy splats mirror of the wanted light, whose vertices receive so much."""
        session, exposure, mixture = self._session, wanted.exposure, wanted.mixture
        light, angle_deg, bench = session.answers.light, session.state.angle_deg, session.bench
        lamps = [] if session.lamps is None else [lamp.asked for lamp in session.lamps.state.lamps]

        def mirrored(received: NDArray[np.floating]) -> NewLight:
            shining = turned_about_y(light.coefficients, angle_deg) * exposure
            alone = NewLight(shining, wanted.radiance, received, exposure)
            if mixture is None:
                return alone
            return alone._replace(
                light=mixture.env_scale * shining,
                radiance=mixture.with_environment(alone.radiance),
                unit=exposure / mixture.level,
                captured=mixture.captured,
                lamps=bench.source.mix.light_of(lamps, mixture.captured) if bench is not None and lamps else None,
            )

        return mirrored


class SplatLayer(NamedTuple):
    """A picture of splats. color: (H, W, 3) float32 sRGB, premultiplied. alpha: (H, W). Top row first."""

    color: NDArray[np.float32]
    alpha: NDArray[np.float32]

    def over(self, behind: NDArray[np.uint8]) -> NDArray[np.uint8]:
        """Before a picture (H, W, 3) uint8 sRGB."""
        through = (1.0 - self.alpha)[..., None] * (behind * np.float32(1.0 / 255.0))
        shown = np.clip(self.color + through, 0.0, 1.0)
        return (shown * np.float32(255.0) + np.float32(0.5)).astype(np.uint8)


class _Seen(NamedTuple):
    """A view with cached shares. basis: (N, K) float32, harmonics of the directions to the splats."""

    orbit: Orbit
    size: tuple[int, int]
    opacities: NDArray[np.float32]
    blending: Blending
    alpha: NDArray[np.float32]
    basis: NDArray[np.float32]


class SplatPainter:
    """Draws splats at the positions of a Scene's splats."""

    def __init__(self, scene: Scene) -> None:
        frame = np.asarray(scene.scene_from_splat, np.float64)
        self._frame, self._near = frame, NEAR_DIAGONAL * scene.diagonal
        self._seen: _Seen | None = None

    def exact(self, splats: Splats, orbit: Orbit, size: tuple[int, int]) -> SplatLayer:
        """The picture as written to files."""
        seen = rasterize(splats, *self._view(orbit, size))
        return SplatLayer(seen.color, seen.alpha)

    def again(self, splats: Splats, orbit: Orbit, size: tuple[int, int]) -> SplatLayer:
        """The same without contributions below 1/512 of a pixel: slower once per view, then much faster."""
        seen = self._seen
        if (
            seen is None
            or (seen.orbit, seen.size) != (orbit, size)
            or not np.array_equal(seen.opacities, splats.opacities)
        ):
            self._seen = seen = self._look(splats, orbit, size)
        colors = np.einsum("nk,nkc->nc", seen.basis, splats.sh, dtype=np.float32) + np.float32(0.5)
        tiles = seen.blending.drawn(np.maximum(np.nan_to_num(colors), np.float32(0.0)))
        return SplatLayer(_out_of_tiles(tiles, size), seen.alpha)

    def _look(self, splats: Splats, orbit: Orbit, size: tuple[int, int]) -> _Seen:
        (view, near), found = self._view(orbit, size), []
        blending = blending_of(splats, [view], near, lambda _, alpha, __: found.append(alpha.copy()))
        toward = splats.means - view.center
        toward = toward / np.maximum(np.linalg.norm(toward, axis=1, keepdims=True), 1e-12)
        basis = sh_basis_3dgs(toward, splats.degree).astype(np.float32)
        return _Seen(orbit, size, splats.opacities, blending, found[0], basis)

    def _view(self, orbit: Orbit, size: tuple[int, int]) -> tuple[View, float]:
        """The camera in the frame of the splats, whose unit may be another, and the nearest distance that it shows."""
        return in_frame(orbit.view(size), self._frame, self._near)


def coarser(size: tuple[int, int]) -> tuple[int, int]:
    """The size of a picture while the camera moves."""
    return max(1, size[0] // COARSE), max(1, size[1] // COARSE)


def joined(left: NDArray[np.uint8], right: NDArray[np.uint8], split_at: float) -> NDArray[np.uint8]:
    """Two pictures (H, W, 3); the first shows left of a position, 0..1 over the width."""
    column = round(split_at * left.shape[1])
    return np.concatenate([left[:, :column], right[:, column:]], axis=1)


def _out_of_tiles(tiles: NDArray[np.float32], size: tuple[int, int]) -> NDArray[np.float32]:
    """Pixels of tiles, (P, 3), as an image (H, W, 3): the inverse of `in_tiles`."""
    width, height = size
    down, across = -(-height // TILE), -(-width // TILE)
    whole = tiles.reshape(down, across, TILE, TILE, 3).swapaxes(1, 2).reshape(down * TILE, across * TILE, 3)
    return whole[:height, :width]
