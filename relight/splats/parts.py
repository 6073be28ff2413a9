"""New light on a part of a capture alone, or on all but a part: shares of it, with a rim, and what they blend.

A part has all of its splats. Around it lies a rim: a splat outside has as much of the part as the splats next to it, so
that the blend is as wide as splats are apart there. What has no share keeps every bit.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import scipy
from numpy.typing import ArrayLike, NDArray

from splat2mesh.base.arrays import Floats, Points
from splat2mesh.base.errors import InputError
from splat2mesh.base.specs import clip, plain
from splat2mesh.base.threads import in_batches
from splat2mesh.scene.scene import Scene
from splat2mesh.splats.cleaning import sound
from splat2mesh.splats.splats import INVISIBLE_OPACITY, SH_C0, Splats

from .light_ratio import CURVE_OFFSET, CURVE_POWER
from .part_spec import AnyPart, PartSpec, Shares, SplatFile

NEXT = 6
"""Splats next to one on a surface: so many circles touch one of their size in a plane."""


@dataclass(frozen=True, eq=False)
class AskedPart:
    """Parts that take a new light, or that alone keep the captured one. specs: one or more. name: the field of the
    request."""

    specs: tuple[PartSpec, ...]
    name: str = "only"

    @classmethod
    def parse(cls, only: Sequence[AnyPart], keep: Sequence[AnyPart]) -> "AskedPart | None":
        """The parts of the fields `only` and `keep` of a request; None without any. Raises InputError that names the
        field."""
        name, given = ("keep", keep) if keep else ("only", only)
        if only and keep:
            raise InputError("`only`: it replaces `keep`; give one of them")
        found = []
        for each in given:
            try:
                found.append(PartSpec.parse(each))
            except InputError as error:
                raise InputError(f"`{name}` {clip(each)}: {plain(error)}") from None
        return cls(tuple(found), name) if found else None

    @property
    def kept(self) -> bool:
        """Whether it is what keeps the captured light."""
        return self.name == "keep"

    @property
    def needs_splats(self) -> bool:
        """Whether some part is known of splats alone."""
        return any(spec.inside is None for spec in self.specs)

    def of_splats(self, file: SplatFile) -> Shares:
        """Shares (N,) of the parts, without a rim. Raises InputError for parts that cannot be found or are empty."""
        found = np.zeros(len(file.splats), np.float32)
        for spec in self.specs:
            try:
                shares = spec.find(file)
            except InputError as error:
                raise self._about(spec, plain(error)) from None
            if not shares.any():
                raise self._about(spec, f"none of {len(shares):,} splats lies in it")
            np.maximum(found, shares, out=found)
        return found

    def of_points(self, points: Points) -> Shares:
        """Shares (M,) of volumes, without a rim. points: (M, 3), in the frame of the splat."""
        found = np.zeros(len(points), np.float32)
        for spec in self.specs:
            assert spec.inside is not None  # `needs_splats` says so
            found[spec.inside(points)] = 1.0
        return found

    def _about(self, spec: PartSpec, problem: str) -> InputError:
        return InputError(f"`{self.name}` {clip(spec.words)}: {problem}")


@dataclass(frozen=True, eq=False)
class PartShares:
    """Shares of the new light. splats: (N,), None without splats. vertices: (V,). report: entry of the report,
    JSON-clean. kept: whether the part is what keeps the captured light."""

    splats: Shares | None
    vertices: Shares
    report: dict[str, Any]
    kept: bool

    @classmethod
    def of(cls, asked: AskedPart, scene: Scene, file: SplatFile | None, found: Shares | None) -> "PartShares":
        """That of a scene. file, found: its splats, and `AskedPart.of_splats` of them; None without. Raises InputError
        where no vertex of a scene without splats lies in the part."""
        points, offset = _in_frame_of_splats(scene), np.zeros(3)
        shares = None
        if file is not None and found is not None:
            offset = np.asarray(file.splats.facts.offset)
            whole = sound(file.splats)
            shares = found.copy()
            shares[whole] = with_rim(file.splats.means[whole], found[whole])
        if not asked.needs_splats:
            volumes = asked.of_points(points + offset)
            if shares is None and not volumes.any():
                raise InputError(f"`{asked.name}`: none of {len(points):,} vertices lies in the part")
            vertices = with_rim(points, volumes)
        else:
            assert file is not None and shares is not None
            seen = np.flatnonzero(sound(file.splats) & (file.splats.opacities >= INVISIBLE_OPACITY))
            vertices = _of_nearest(points, file.splats.means[seen], shares[seen])
        counts = {"vertices": _counts(vertices)}
        if shares is not None and found is not None:
            counts["splats"] = {**_counts(shares), "part": int(np.count_nonzero(found))}
        report = {asked.name: [spec.words for spec in asked.specs], **counts}
        if asked.kept:
            shares, vertices = None if shares is None else 1.0 - shares, 1.0 - vertices
        return cls(shares, vertices, report, asked.kept)


def _counts(shares: Shares) -> dict[str, int]:
    return {"all": len(shares), "rim": int(((shares > 0.0) & (shares < 1.0)).sum())}


def _in_frame_of_splats(scene: Scene) -> NDArray[np.float64]:
    """Vertices (V, 3) of a scene in the frame of its splats."""
    back = np.linalg.inv(np.asarray(scene.scene_from_splat, np.float64))
    return np.asarray(scene.vertices @ back[:3, :3].T + back[:3, 3])


def with_rim(points: Points, shares: Shares) -> Shares:
    """Shares (M,) of points (M, 3) with a rim: outside the part a point has the mean of the points next to it.

    Shares that are neither 0 nor 1 have a rim of their own: all stay.
    """
    if ((shares > 0.0) & (shares < 1.0)).any() or len(points) <= NEXT:
        return shares
    outside = np.flatnonzero(shares == 0.0)
    found = shares.copy()
    found[outside] = _of_nearest(points[outside], points, shares, 1)
    return found


def _of_nearest(points: Points, of: Points, shares: Shares, itself: int = 0) -> Shares:
    """Mean share (M,) of the NEXT of other points (N, 3) that are nearest to each of points (M, 3).

    itself: 1 where each is one of these others, with share 0, else 0.
    """
    tree, result = scipy.spatial.cKDTree(of), np.zeros(len(points), np.float32)
    count = min(NEXT + itself, len(of))

    def ask(rows: slice) -> None:
        nearest = tree.query(points[rows], count)[1].reshape(-1, count)
        result[rows] = shares[nearest].sum(axis=1, dtype=np.float64) / (count - itself)

    in_batches(ask, len(points))
    return np.minimum(result, np.float32(1.0))


def blended_splats(captured: Splats, relit: Splats, shares: Shares) -> Splats:
    """Splats with the new light by their shares (N,): row by row those of both, of which colours and opacities differ.

    Share 0 keeps every bit of `captured`, 1 those of `relit`. Between, colours are mixed in linear light.
    """
    sh, opacities = captured.sh.copy(), captured.opacities.copy()
    full, rim = shares == 1.0, np.flatnonzero((shares > 0.0) & (shares < 1.0))
    sh[full], opacities[full] = relit.sh[full], relit.opacities[full]
    share = shares[rim, None]
    first, second = (_linear(0.5 + SH_C0 * each.sh[rim, 0].astype(np.float64)) for each in (captured, relit))
    sh[rim, 0] = (_shown(first + share * (second - first)) - 0.5) / SH_C0
    sh[rim, 1:] += share[:, None] * (relit.sh[rim, 1:] - sh[rim, 1:])
    opacities[rim] += share[:, 0] * (relit.opacities[rim] - opacities[rim])
    return replace(captured, sh=sh, opacities=opacities)


def _linear(shown: Floats) -> Floats:
    """Linear values of display values, by the curve of `light_ratio`; odd about its zero: Gaussians may be darker than
    black."""
    lifted = (shown + CURVE_OFFSET) / (1.0 + CURVE_OFFSET)
    return np.sign(lifted) * np.abs(lifted) ** CURVE_POWER


def _shown(linear: Floats) -> Floats:
    """The inverse of `_linear`."""
    return (1.0 + CURVE_OFFSET) * np.sign(linear) * np.abs(linear) ** (1.0 / CURVE_POWER) - CURVE_OFFSET


def blended(captured: ArrayLike, relit: ArrayLike, shares: Shares) -> NDArray[np.float32]:
    """Linear values (V, 3) of vertices with the new light by their shares (V,). Shares 0 and 1 keep every bit."""
    first, second, share = np.asarray(captured, np.float32), np.asarray(relit, np.float32), shares[:, None]
    mixed = first + share * (second - first)
    return np.where(share == 0.0, first, np.where(share == 1.0, second, mixed))
