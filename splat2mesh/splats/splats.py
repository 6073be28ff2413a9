"""Gaussian splats as arrays, and their colours."""

import os
from collections.abc import Sequence
from dataclasses import dataclass, replace
from types import ModuleType
from typing import Any, ClassVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..base.errors import InputError
from ..base.outputs import check_output
from ..base.threads import ROWS_AT_ONCE
from .facts import NO_FACTS, FileFacts
from .harmonics import DEGREE_OF_COEFFICIENTS, SH_C0, sh_basis_3dgs
from .zorder import rows_along_curve

# The 3DGS rasteriser skips a Gaussian where its alpha is below this: a fainter one never reaches a pixel.
INVISIBLE_OPACITY = 1 / np.iinfo(np.uint8).max
# Above this opacity a Gaussian counts as part of a surface, below it as haze about one.
SOLID = 0.3
# Standard deviations that a Gaussian reaches: beyond, its opacity is below 1/90 of that in its middle.
REACH = 3.0
# Squares of lengths, and sums of them, must stay far inside float32 (3.4e38).
ABSURD_LENGTH = 1e15
# A scale of exactly zero is an underflow of exp. Raised to this share of the splat's largest scale it still
# looks flat, and the covariance can be inverted.
FLATTEST = 1e-4
# A splat covers one flat patch. The coarsest closed surface, a tetrahedron, has four; about twice as many are the least
# that distinguishes a surface from noise.
MIN_SPLATS = 10

NUMBERS = ("means", "scales", "quats_wxyz", "opacities", "sh")
"""The fields of Splats that hold numbers, in their order."""


@dataclass(frozen=True, eq=False)
class Splats:
    """N Gaussians with activated parameters, in the frame of an INRIA PLY (the COLMAP world, usually y-down).

    Attributes
    ----------
    means : ndarray of float32, (N, 3)
        Centres in world units.
    scales : ndarray of float32, (N, 3)
        Standard deviations along the splat's own axes, linear (exp already applied), world units.
    quats_wxyz : ndarray of float32, (N, 4)
        Rotations world_from_splat; brought to unit length here, all-zero rows stay zero.
    opacities : ndarray of float32, (N,)
        In [0, 1] (sigmoid already applied).
    sh : ndarray of float32, (N, K, 3)
        Colour coefficients, K in 1, 4, 9, 16, display-referred sRGB, basis of `sh_basis_3dgs`.
    environment : ndarray of bool, (N,), or None
        Which splats the capture itself keeps apart as its surroundings (the sky and the far distance of a streamed
        SOG), or None where it does not say.
    facts : FileFacts
        What the file says beside.

    Raises
    ------
    InputError
        For a wrong shape or an opacity outside [0, 1].

    Notes
    -----
    Arrays are stored contiguous and converted to these types.
    """

    means: np.ndarray
    scales: np.ndarray
    quats_wxyz: np.ndarray
    opacities: np.ndarray
    sh: np.ndarray
    environment: np.ndarray | None = None
    facts: FileFacts = NO_FACTS
    files: ClassVar[ModuleType]
    """`formats`, which makes Splats and so cannot be imported here: the package sets it."""

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
        """Read any supported splat: every row in its order, not cleaned (see `clean`).

        path: a file or folder, as for `formats.read_splats`. lod: level of detail of a streamed SOG, 0 being the
        finest. Raises InputError when a file is missing, empty, cut short, or of another kind. Warns with a DataWarning
        when "auto" passes over a finer level.
        """
        splats: Splats = cls.files.read_splats(path, lod)
        return splats

    def save(self, path: str | os.PathLike[str], overwrite: bool = False) -> None:
        """Write the splats in the format of the name's suffix; the file appears only once it is complete.

        path: ends in .ply, which is exact, or in .spz, .compressed.ply or .sog, which are small and quantised. Raises
        InputError for another suffix, for a folder, and for a file that exists and may not be replaced. Warns with a
        DataWarning about data that the format cannot hold.

        >>> splats = Splats.load("garden.ply")  # doctest: +SKIP
        >>> splats.take(splats.opacities > 0.1).save("garden.spz")  # doctest: +SKIP
        """
        kind = self.files.kind_of_name(path)
        if os.path.isdir(path):
            raise InputError(f"{path} is a folder: give the name of a file")
        check_output(path, overwrite)
        self.files.write_splats(path, self, kind)

    def __len__(self) -> int:
        return len(self.means)

    @property
    def degree(self) -> int:
        """Degree of the colour's spherical harmonics: 0 to 3."""
        return DEGREE_OF_COEFFICIENTS[self.sh.shape[1]]

    def take(self, rows: slice | NDArray[Any]) -> "Splats":
        """Return the splats at some rows, in that order: themselves where these are all rows as they are. rows:
        indices, a slice, or an (N,) boolean mask."""
        every = np.arange(len(self))
        index = every[rows]
        if np.array_equal(index, every):
            return self
        given = {name: getattr(self, name) for name in (*NUMBERS, "environment") if getattr(self, name) is not None}
        if isinstance(rows, slice):
            return replace(self, **{name: values[rows] for name, values in given.items()})
        # `take` copies rows of few numbers in a third of the time of brackets.
        return replace(self, **{name: values.take(index, axis=0) for name, values in given.items()})

    def in_spatial_order(self) -> "Splats":
        """Return the same splats in the order of `spatial_order`. Means must be finite."""
        return self.take(self.spatial_order())

    def spatial_order(self) -> NDArray[np.int64]:
        """Return the rows, (N,) int64, along a Z-order curve: neighbours in space are neighbours in memory."""
        return rows_along_curve(self.means)

    def rotation_matrices(self) -> NDArray[np.float32]:
        """Return the rotations as matrices, (N, 3, 3) float32, world_from_splat: column i is the world direction of the
        splat's axis i."""
        w, x, y, z = self.quats_wxyz.T
        rows = (
            (1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)),
            (2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)),
            (2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)),
        )
        return np.stack([np.stack(row, axis=-1) for row in rows], axis=-2)

    def covariances(self) -> NDArray[np.float32]:
        """Return the covariances R diag(scales^2) R^T, (N, 3, 3) float32, world frame, squared world units, exactly
        symmetric."""
        half = self.rotation_matrices() * self.scales[:, None, :]
        return np.einsum("nik,njk->nij", half, half)

    @property
    def colors_diffuse(self) -> NDArray[Any]:
        """(N, 3) float32 sRGB without view dependence: C0 dc + 1/2, not clipped."""
        return SH_C0 * self.sh[:, 0] + np.float32(0.5)

    def colors_toward(self, eye: ArrayLike) -> NDArray[Any]:
        """Return the colours, (N, 3) float32 sRGB, at least 0, as seen from an eye, (3,) in world units.

        The harmonics are evaluated in the direction from the eye to each centre, as the 3DGS rasteriser does. Raises
        InputError for an eye of another shape.
        """
        eye = np.asarray(eye, np.float32)
        if eye.shape != (3,):
            raise InputError(f"an eye is one world point of shape (3,), found {eye.shape}")
        return colors_toward(self.means, self.sh, eye)


def colors_toward(means: NDArray[Any], sh: NDArray[Any], eye: NDArray[Any]) -> NDArray[Any]:
    """`Splats.colors_toward` of centres (N, 3) and colour coefficients (N, K, 3)."""
    colors, degree = SH_C0 * sh[:, 0] + np.float32(0.5), DEGREE_OF_COEFFICIENTS[sh.shape[1]]
    if degree > 0:
        for start in range(0, len(means), ROWS_AT_ONCE):
            rows = slice(start, start + ROWS_AT_ONCE)
            basis = sh_basis_3dgs(_unit(means[rows] - eye), degree)
            colors[rows] += np.einsum("nk,nkc->nc", basis[:, 1:], sh[rows, 1:])
    return np.maximum(colors, 0, out=colors)


def _unit(vectors: NDArray[Any]) -> NDArray[Any]:
    """Rows at unit length; zero rows stay zero, rows already unit to float32 rounding keep every bit."""
    with np.errstate(over="ignore", invalid="ignore"):
        length = np.sqrt(np.einsum("ij,ij->i", vectors, vectors))
        off = ~(np.abs(length - 1) < 1e-6)
        if not off.any():
            return vectors
        return vectors / np.where(off & (length > 0), length, np.float32(1))[:, None]


def _text(shape: Sequence[int | str]) -> str:
    return "(" + ", ".join(map(str, shape)) + ("," if len(shape) == 1 else "") + ")"
