"""Light beside the environment: placed lamps and captured light, each a term with its strength and colour.

The change of light of a splat is that of the environment plus, for every term, strength x colour x the term's value
for the splat: its light ratio under that lamp, were it white. A term is stored only where it shines, as runs of rows
of three bytes, logarithms of the ratio.
"""

from collections.abc import Callable
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray

from splat2mesh.base.arrays import Floats
from splat2mesh.scene.color import luminance

from ..lamps.photometry import axis_intensity
from ..lamps.shapes import Lamp, MeshLamp
from ..splats.light_ratio import MOST, linear_parts

if TYPE_CHECKING:
    from ..engine.light_mix import LightMix
    from ..lamps.emitters import Emitters
    from ..transfer.occluder import Frame

CAPTURED, LAMP = "captured", "lamp"

LEAST = 2.0**-10
"""Least light ratio of a stored splat, relative to the 98th percentile for a lamp that is weaker than the captured
light: on white it is three display steps."""

MARGIN = 8.0
"""Range of the channels of a splat below the least stored ratio, since bounced light is coloured."""

MOST_LAMPS = 32
"""Most terms of lamps: further lamps share the last term and its slider."""

GAP = 2
"""Largest gap of rows within a run: a run takes 8 bytes, a row 3."""


class Source(NamedTuple):
    """Light that becomes a term. kind: CAPTURED or LAMP. name: as shown. color: (3,) linear, of luminance 1.
    received: (V, 3) float32 irradiance over pi in units of the picture, of that light in white; None for the
    unchanged captured light. place: (3,) its position, splat frame, or None. shines: of a single lamp, its emitters and
    the Frame that they are in."""

    kind: str
    name: str
    color: NDArray[np.float64]
    received: NDArray[np.float32] | None
    place: list[float] | None = None
    shines: "tuple[Emitters, Frame] | None" = None


def sources_of(mix: "LightMix") -> list[Source]:
    """The captured light of a LightMix and each of its lamps as Sources."""
    look, white, received = mix.look, np.ones(3), None
    colors = mix.room.with_its_own_light() if mix.room else look.captured
    if not np.array_equal(colors, look.captured):
        change = np.divide(colors, look.captured, out=np.ones_like(look.captured), where=look.captured > 0.0)
        received = change * look.irradiance
    count, found = len(mix.asked_lamps), [Source(CAPTURED, "Captured light", white, received)]
    alone = count if count <= MOST_LAMPS else MOST_LAMPS - 1
    groups = [[number] for number in range(alone)] + [list(range(alone, count))] * (alone < count)
    return found + [_of_lamps(mix, group) for group in groups]


def _of_lamps(mix: "LightMix", group: list[int]) -> Source:
    """The Source of lamps by their numbers."""
    light, lamps = mix.lamp_light, [mix.lamps[number] for number in group]
    assert light is not None
    color = np.sum([axis_intensity(lamp) for lamp in lamps], axis=0)
    several = len(lamps) > 1 or any(isinstance(lamp, MeshLamp) and lamp.radiance.ndim == 2 for lamp in lamps)
    direct, tint = as_white(light.direct_of(*group), color, several)
    if len(lamps) == len(mix.lamps) and (tint > 0.0).all():  # the result has their light
        received = np.asarray(light.placed.received / tint, np.float32)
    else:  # bounces keep the colours apart
        received = light.with_bounces(direct).received
    if len(lamps) > 1:
        return Source(LAMP, f"{len(lamps)} more lamps", tint, received)
    name = mix.asked_lamps[group[0]].name or f"Lamp {group[0] + 1}"
    return Source(LAMP, name, tint, received, _place_of(lamps[0]), (light.emitters.of_lamp(*group), light.frame))


def _place_of(lamp: Lamp) -> list[float]:
    """Position of a lamp, (3,): its middle, or an end of a tube."""
    if isinstance(lamp, MeshLamp):
        return [float(each) for each in lamp.vertices.mean(axis=0)]
    return [float(each) for each in next(getattr(lamp, n) for n in ("position", "center", "start") if hasattr(lamp, n))]


class Term(NamedTuple):
    """A stored Source. runs: (R, 2) uint32, first row and count. rows: (M, 3) uint8 of the rows in the runs,
    concatenated: 0 is none, else peak 2^((byte - 255) / steps). peak: (3,). mean: (3,) light ratio of the whole scene.
    error: relative root mean square error of the bytes. runs is None for the unchanged captured light, 1 everywhere.
    """

    kind: str
    name: str
    color: list[float]
    place: list[float] | None
    runs: NDArray[np.uint32] | None
    rows: NDArray[np.uint8]
    peak: list[float]
    steps: float
    mean: list[float]
    error: float

    def tobytes(self) -> bytes:
        """runs and rows, little-endian, concatenated."""
        return b"" if self.runs is None else self.runs.astype("<u4").tobytes() + self.rows.tobytes()

    def described(self) -> dict:
        """Its entry in live.json: dict, JSON-clean."""
        counts = (None, None) if self.runs is None else (len(self.runs), len(self.rows))
        return self._asdict() | dict(zip(("runs", "rows"), counts, strict=True))

    def values(self, count: int) -> NDArray[np.float32]:
        """The decoded light ratio of `count` splats, (count, 3)."""
        if self.runs is None:
            return np.ones((count, 3), np.float32)
        stored = np.asarray(self.peak) * 2.0 ** ((self.rows.astype(np.float64) - 255.0) / self.steps)
        found = np.zeros((count, 3), np.float32)
        found[rows_of(self.runs)] = np.where(self.rows > 0, stored, 0.0)
        return found


def term_of(
    source: Source,
    captured: NDArray[np.float32],  # (V, 3) linear colours
    before: NDArray[np.float32],  # (V, 3) irradiance over pi of the capture
    shares: NDArray[np.floating],  # (V,) weights of vertices in the mean
    of_splats: Callable[[NDArray[np.float32]], NDArray[np.float32]],  # (V, 3) to the rows of the bundle, (N, 3)
) -> Term:
    """The Term of a Source: the light ratio of relit splats, before its roll-off, which is linear in the light."""
    color = [float(each) for each in source.color]
    if source.received is None:
        nothing = np.zeros((0, 3), np.uint8)
        return Term(source.kind, source.name, color, None, None, nothing, [1.0] * 3, 1.0, [1.0] * 3, 0.0)
    own, usual = linear_parts(captured, before)
    whole = (shares @ source.received.astype(np.float64)) / np.maximum(shares @ before.astype(np.float64), 1e-12)
    values = of_splats((own * source.received + usual * whole).astype(np.float32))
    runs, rows, peak, steps = _stored(np.minimum(values, np.float32(MOST)))
    mean = [float(each) for each in whole]
    term = Term(source.kind, source.name, color, source.place, runs, rows, peak, steps, mean, 0.0)
    size = float(np.sqrt(np.square(values, dtype=np.float64).mean()))
    off = float(np.sqrt(np.square(term.values(len(values)) - values, dtype=np.float64).mean()))
    return term._replace(error=off / size if size > 0.0 else 0.0)


def as_white(
    direct: NDArray[np.float32], color: NDArray[np.float64], mixed: bool = False
) -> tuple[NDArray[np.float32], NDArray[np.float64]]:
    """Direct light (V, 3) as white light, and its colour (3,), of luminance 1.

    color: of the light, any luminance. mixed: whether it has several colours; then each channel is divided by its own.
    """
    bright = float(luminance(color))
    tint = np.asarray(color, np.float64) / bright if bright > 0.0 else np.ones(3)
    white = np.repeat(luminance(direct)[:, None], 3, axis=1).astype(np.float32)
    if mixed:
        white = np.where(tint > 0.0, direct / np.where(tint > 0.0, tint, 1.0), white).astype(np.float32)
    return white, tint


def _stored(values: NDArray[np.float32]) -> tuple[NDArray[np.uint32], NDArray[np.uint8], list[float], float]:
    """Runs, rows, peak and steps of light ratios (N, 3)."""
    largest, peak = values.max(axis=1), values.max(axis=0).astype(np.float64)
    shining = largest[largest > 0.0]
    usual = float(np.percentile(shining, 98.0)) if len(shining) else 1.0
    least = LEAST * min(1.0, usual)
    runs = runs_of(largest >= least)
    peak = np.maximum(peak, least)
    steps = 254.0 / float(np.log2(peak.max() * MARGIN / least))
    return runs, as_bytes(values[rows_of(runs)], peak, steps), peak.tolist(), steps


def as_bytes(values: Floats, peak: Floats | float, steps: float) -> NDArray[np.uint8]:
    """Values up to a peak as bytes, so many steps for a factor of two, 255 for the peak and 0 for none."""
    level = 255.0 + steps * np.log2(np.maximum(values, 1e-30) / peak)
    return np.where(level >= 0.5, np.clip(np.rint(level), 1, 255), 0).astype(np.uint8)


def runs_of(kept: NDArray[np.bool_]) -> NDArray[np.uint32]:
    """(R, 2) first row and count of the kept rows, mask (N,), across gaps of up to GAP rows."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], kept, [False]]).astype(np.int8)))
    first, end = edges[::2], edges[1::2]
    apart = first[1:] - end[:-1] > GAP
    first, end = first[np.concatenate([[True], apart])[: len(first)]], end[np.concatenate([apart, [True]])[: len(end)]]
    return np.stack([first, end - first], axis=1).astype(np.uint32)


def rows_of(runs: NDArray[np.uint32]) -> NDArray[np.int64]:
    """The numbers of the rows in runs, concatenated."""
    first, count = runs.astype(np.int64).T
    return np.repeat(first - np.cumsum(count) + count, count) + np.arange(int(count.sum()))
