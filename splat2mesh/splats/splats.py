"""Gaussian splats as arrays, their colours, and the removal of those that cannot be used."""

import os
import warnings
from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..base.errors import DataWarning, InputError

SH_C0 = float(np.sqrt(1 / (4 * np.pi)))
DEGREE_OF_COEFFICIENTS = {1: 0, 4: 1, 9: 2, 16: 3}

# The 3DGS rasteriser skips a Gaussian where its alpha is below this: a fainter one never reaches a pixel.
INVISIBLE_OPACITY = 1 / 255
# Squares of lengths, and sums of them, must stay far inside float32 (3.4e38).
ABSURD_LENGTH = 1e15
# A scale of exactly zero is an underflow of exp. Raised to this share of the splat's largest scale it still
# looks flat, and the covariance can be inverted.
FLATTEST = 1e-4
# A splat covers one flat patch. The coarsest closed surface, a tetrahedron, has four; about twice as many are
# the least from which a surface can be told from noise.
MIN_SPLATS = 10

NUMBERS = ("means", "scales", "quats_wxyz", "opacities", "sh")
"""The fields of Splats that hold numbers, in their order."""

_BLOCK = 65536


@dataclass(frozen=True, eq=False)
class Splats:
    """N Gaussians with activated parameters, in the frame of an INRIA PLY (the COLMAP world, usually y-down).

    means: (N, 3) centres in world units.
    scales: (N, 3) standard deviations along the splat's own axes, linear (exp already applied), world units.
    quats_wxyz: (N, 4) rotations world_from_splat; brought to unit length here, all-zero rows stay zero.
    opacities: (N,) in [0, 1] (sigmoid already applied).
    sh: (N, K, 3) colour coefficients, K in 1, 4, 9, 16, display-referred sRGB, basis of `sh_basis_3dgs`.
    environment: (N,) bool, which splats the capture itself keeps apart as its surroundings (the sky and the far
    distance of a streamed SOG), or None where it does not tell.

    All others are stored as contiguous float32. Raises InputError for a wrong shape or an opacity outside [0, 1].
    """

    means: np.ndarray
    scales: np.ndarray
    quats_wxyz: np.ndarray
    opacities: np.ndarray
    sh: np.ndarray
    environment: np.ndarray | None = None

    def __post_init__(self) -> None:
        for name in NUMBERS:
            object.__setattr__(self, name, np.ascontiguousarray(getattr(self, name), np.float32))
        n = self.opacities.shape[0] if self.opacities.ndim == 1 else "N"
        expected = {"means": (n, 3), "scales": (n, 3), "quats_wxyz": (n, 4), "opacities": (n,)}
        for name, shape in expected.items():
            if getattr(self, name).shape != shape:
                raise InputError(f"splats need {name} of shape {_text(shape)}, found {getattr(self, name).shape}")
        if self.sh.ndim != 3 or self.sh.shape[::2] != (n, 3) or self.sh.shape[1] not in DEGREE_OF_COEFFICIENTS:
            raise InputError(f"splats need sh of shape ({n}, K, 3) with K = 1, 4, 9 or 16, found {self.sh.shape}")
        if self.environment is not None:
            object.__setattr__(self, "environment", np.ascontiguousarray(self.environment, bool))
            if self.environment.shape != (n,):
                raise InputError(f"splats need environment of shape ({n},), found {self.environment.shape}")
        outside = (self.opacities < 0) | (self.opacities > 1)
        if outside.any():
            raise InputError(
                f"splats need opacities in [0, 1], found {self.opacities[outside][0]:g}: apply the sigmoid to logits"
            )
        object.__setattr__(self, "quats_wxyz", _unit(self.quats_wxyz))

    @classmethod
    def load(cls, path: str | os.PathLike[str], lod: int | str = "auto") -> "Splats":
        """Read any supported splat.

        Parameters
        ----------
        path : path
            A file or folder, as for `formats.read_splats`.
        lod : int or "auto"
            Level of detail of a streamed SOG, 0 being the finest.

        Returns
        -------
        Splats
            Every row of the file in its order, not cleaned (see `clean`).

        Raises
        ------
        InputError
            When a file is missing, empty, cut short, or of another kind.

        Warns
        -----
        DataWarning
            When "auto" passes over a finer level.
        """
        from .formats import read_splats

        return read_splats(path, lod)

    def save(self, path: str | os.PathLike[str], overwrite: bool = False) -> None:
        """Write the splats in the kind that the name ends in; the file appears only once it is complete.

        Parameters
        ----------
        path : path
            Ends in .ply, which is exact, or in .spz or .compressed.ply, which are small and quantised.
        overwrite : bool
            Whether a file of that name may be replaced.

        Raises
        ------
        InputError
            For another ending, for a folder, and for a file that exists and may not be replaced.

        Warns
        -----
        DataWarning
            About what the format cannot hold.

        Examples
        --------
        >>> splats = Splats.load("garden.ply")  # doctest: +SKIP
        >>> splats.take(splats.opacities > 0.1).save("garden.spz")  # doctest: +SKIP
        """
        from ..base.outputs import check_output
        from .formats import kind_of_name, write_splats

        kind = kind_of_name(path)
        if os.path.isdir(path):
            raise InputError(f"{path} is a folder: give the name of a file")
        check_output(path, overwrite)
        write_splats(path, self, kind)

    def __len__(self) -> int:
        return len(self.means)

    @property
    def degree(self) -> int:
        """Degree of the colour's spherical harmonics: 0 to 3."""
        return DEGREE_OF_COEFFICIENTS[self.sh.shape[1]]

    def take(self, rows: slice | NDArray[Any]) -> "Splats":
        """The splats at `rows`: indices, a slice, or an (N,) boolean mask."""
        values: list[Any] = [None if value is None else value[rows] for value in self._values()]
        return Splats(*values)

    def _values(self) -> list[Any]:
        return [getattr(self, field.name) for field in fields(self)]

    def in_spatial_order(self) -> "Splats":
        """The same splats along a Z-order curve: neighbours in space are neighbours in memory. Needs finite means."""
        return self.take(self.spatial_order())

    def spatial_order(self) -> NDArray[np.int64]:
        """Rows along a Z-order curve, (N,) int64.

        Training leaves splats in no order at all, and whoever then picks them by depth waits for memory: in millions
        of splats this makes rendering twice as fast. Source: Morton, "A Computer Oriented Geodetic Data Base" (1966).
        """
        low, high = np.percentile(self.means[:: 1 + len(self) // 65536], [1, 99], axis=0).astype(np.float32)
        cells = (self.means - low) / max(float((high - low).max()), 1 / ABSURD_LENGTH) * 1023
        x, y, z = _bits_apart(np.clip(cells, 0, 1023).astype(np.uint64)).T
        keys = (x << 2 | y << 1 | z) << 32 | np.arange(len(self), dtype=np.uint64)
        keys.sort()
        return (keys & np.uint64(0xFFFFFFFF)).view(np.int64)

    def rotation_matrices(self) -> NDArray[np.float32]:
        """(N, 3, 3) float32 world_from_splat; column i is the world direction of the splat's axis i."""
        w, x, y, z = self.quats_wxyz.T
        rows = (
            (1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)),
            (2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)),
            (2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)),
        )
        return np.stack([np.stack(row, axis=-1) for row in rows], axis=-2)

    def covariances(self) -> NDArray[np.float32]:
        """(N, 3, 3) float32 world covariances R diag(scales^2) R^T, exactly symmetric."""
        half = self.rotation_matrices() * self.scales[:, None, :]
        return np.einsum("nik,njk->nij", half, half)

    @property
    def colors_diffuse(self) -> NDArray[Any]:
        """(N, 3) float32 sRGB without view dependence: C0 dc + 1/2, not clipped."""
        return SH_C0 * self.sh[:, 0] + np.float32(0.5)

    def colors_toward(self, eye: ArrayLike) -> NDArray[Any]:
        """Colours as seen from a point: (3,) world -> (N, 3) float32 sRGB, at least 0.

        The harmonics are evaluated in the direction from the eye to each centre, as the 3DGS rasteriser does.
        """
        eye = np.asarray(eye, np.float32)
        if eye.shape != (3,):
            raise InputError(f"an eye is one world point of shape (3,), found {eye.shape}")
        colors = self.colors_diffuse
        if self.degree > 0:
            for start in range(0, len(self), _BLOCK):
                rows = slice(start, start + _BLOCK)
                basis = sh_basis_3dgs(_unit(self.means[rows] - eye), self.degree)
                colors[rows] += np.einsum("nk,nkc->nc", basis[:, 1:], self.sh[rows, 1:])
        return np.maximum(colors, 0, out=colors)


def sh_basis_3dgs(directions: NDArray[Any], degree: int) -> NDArray[Any]:
    """Real orthonormal spherical harmonics with the signs of 3DGS files, (-1)^m.

    directions: (N, 3) unit vectors. degree: 0 to 3. Returns (N, (degree + 1)^2) in the dtype of `directions`,
    index l (l + 1) + m. Source: Sloan, "Stupid Spherical Harmonics Tricks", appendix A2, with odd m negated.
    """
    x, y, z = directions.T
    root = [float(np.sqrt(k / np.pi)) for k in (3 / 4, 15 / 4, 5 / 16, 15 / 16, 35 / 32, 105 / 4, 21 / 32, 7 / 16)]
    c1, c2, c20, c22, c33, c32, c31, c30 = root
    basis = [np.full_like(x, SH_C0)]
    if degree > 0:
        basis += [-c1 * y, c1 * z, -c1 * x]
    if degree > 1:
        basis += [c2 * x * y, -c2 * y * z, c20 * (3 * z * z - 1), -c2 * x * z, c22 * (x * x - y * y)]
    if degree > 2:
        basis += [-c33 * y * (3 * x * x - y * y), c32 * x * y * z, -c31 * y * (5 * z * z - 1)]
        basis += [c30 * z * (5 * z * z - 3), -c31 * x * (5 * z * z - 1)]
        basis += [c32 / 2 * z * (x * x - y * y), -c33 * x * (x * x - 3 * y * y)]
    return np.stack(basis, axis=-1)


def usable(splats: Splats) -> tuple[NDArray[np.bool_], dict[str, int]]:
    """Which splats `clean` keeps, (N,) bool, and the dict of its counts."""
    values = [getattr(splats, name).reshape(len(splats), -1) for name in NUMBERS]
    finite = np.logical_and.reduce([np.isfinite(value).all(axis=1) for value in values])
    with np.errstate(invalid="ignore"):
        largest = splats.scales.max(axis=1)
        too_large = (np.abs(splats.means).max(axis=1) > ABSURD_LENGTH) | (largest > ABSURD_LENGTH)
        faults = {
            "non_finite": ~finite,
            "absurd": too_large | (splats.scales.min(axis=1) < 0) | (largest <= 0),
            "zero_quaternion": ~splats.quats_wxyz.any(axis=1),
            "invisible": splats.opacities < INVISIBLE_OPACITY,
        }
    counts, keep = {}, np.ones(len(splats), bool)
    for name, rows in faults.items():
        counts[name] = int(np.count_nonzero(rows & keep))
        keep &= ~rows
    return keep, counts


def clean(splats: Splats) -> tuple[Splats, dict[str, int]]:
    """Drop the splats that cannot be used: returns (Splats, dict of counts).

    Dropped, each counted once: `non_finite` (a NaN or an infinity in any field), `absurd` (a coordinate or
    scale beyond ABSURD_LENGTH, a negative scale, or no extent at all), `zero_quaternion`, and `invisible`
    (opacity below 1/255: normal in trained files). A zero scale beside a positive one is raised by FLATTEST.
    Warns with a DataWarning about all but the invisible. Raises InputError when fewer than MIN_SPLATS remain.
    """
    keep, counts = usable(splats)
    kept = splats if keep.all() else splats.take(keep)
    if len(kept) < MIN_SPLATS:
        lost = ", ".join(f"{count} {name.replace('_', ' ')}" for name, count in counts.items() if count)
        raise InputError(
            f"{len(kept)} of {len(splats)} splats are usable ({lost or 'none dropped'}), "
            f"at least {MIN_SPLATS} are needed: check that the file holds a trained splat"
        )
    broken = {
        "non_finite": "a NaN or infinite value",
        "absurd": "a position or scale out of any useful range",
        "zero_quaternion": "a zero quaternion",
    }
    parts = [f"{counts[name]} with {what}" for name, what in broken.items() if counts[name]]
    if parts:
        warnings.warn(f"dropped splats: {', '.join(parts)} (of {len(splats)})", DataWarning, stacklevel=2)
    return _thickened(kept), counts


def _thickened(splats: Splats) -> Splats:
    flat = (splats.scales == 0).any(axis=1)
    if not flat.any():
        return splats
    scales = np.maximum(splats.scales, np.where(flat, FLATTEST * splats.scales.max(axis=1), 0)[:, None])
    warnings.warn(f"thickened {np.count_nonzero(flat)} splats with a scale of zero", DataWarning, stacklevel=3)
    return replace(splats, scales=scales)


def _unit(vectors: NDArray[Any]) -> NDArray[Any]:
    """Rows at unit length; zero rows stay zero, rows already unit to float32 rounding keep every bit."""
    with np.errstate(over="ignore", invalid="ignore"):
        length = np.sqrt(np.einsum("ij,ij->i", vectors, vectors))
        off = ~(np.abs(length - 1) < 1e-6)
        if not off.any():
            return vectors
        return vectors / np.where(off & (length > 0), length, np.float32(1))[:, None]


def _bits_apart(values: NDArray[Any]) -> NDArray[Any]:
    """Ten-bit integers with two zeros before each bit: any shape uint64, 0b11 becomes 0b1001."""
    for shift, mask in ((16, 0x030000FF), (8, 0x0300F00F), (4, 0x030C30C3), (2, 0x09249249)):
        values = (values | values << shift) & mask
    return values


def _text(shape: Sequence[int | str]) -> str:
    return "(" + ", ".join(map(str, shape)) + ("," if len(shape) == 1 else "") + ")"
