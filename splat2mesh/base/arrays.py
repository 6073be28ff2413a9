"""Names for arrays that say their shape and frame; NumPy's types only give the element type.

N counts splats or points, V vertices, F faces, B bands, K = B^2 coefficients.
"""

from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

Floats: TypeAlias = NDArray[np.floating]
"""Any shape, float32 or float64: the parameter or the docstring says which."""

Integers: TypeAlias = NDArray[np.integer]
"""Any shape, whole numbers of any width."""

Mask: TypeAlias = NDArray[np.bool_]
"""(N,) or of an image, bool: the selected entries."""

Indices: TypeAlias = NDArray[np.int64]
"""(M,) int64: rows of another array."""

Points: TypeAlias = NDArray[np.floating]
"""(N, 3) float, places in the frame of the splat or of the scene, as the parameter says."""

Directions: TypeAlias = NDArray[np.floating]
"""(N, 3) float, unit vectors in the frame of the points beside them."""

Rays: TypeAlias = NDArray[np.floating]
"""(N, 6) or (..., 6) float: an origin and a direction of any length."""

Vector: TypeAlias = NDArray[np.floating]
"""(3,) float: one place or direction."""

Triple: TypeAlias = tuple[float, float, float]
"""The same as three plain numbers, in requests; or red, green and blue."""

Bounds: TypeAlias = NDArray[np.floating]
"""(2, 3) float: the lowest and the highest corner of a box along the axes."""

Faces: TypeAlias = NDArray[np.int32]
"""(F, 3) int32: vertices of triangles, counter-clockwise from outside."""

Matrix3: TypeAlias = NDArray[np.float64]
"""(3, 3) float64: a rotation, `dst_from_src` as the name says."""

Matrix4: TypeAlias = NDArray[np.float64]
"""(4, 4) float64: an affine transform of columns (x, y, z, 1), `dst_from_src` as the name says."""

Quaternions: TypeAlias = NDArray[np.floating]
"""(N, 4) float, unit, w x y z."""

ColorsSrgb: TypeAlias = NDArray[np.uint8]
"""(V, 3) or (H, W, 3) uint8, display-referred sRGB."""

Radiance: TypeAlias = NDArray[np.floating]
"""(V, 3) or (H, W, 3) float, linear Rec.709 red, green, blue: radiance, irradiance over pi, or albedo."""

DepthMap: TypeAlias = NDArray[np.float32]
"""(H, W) float32: camera z of each pixel, NaN where nothing is."""

Coefficients: TypeAlias = NDArray[np.floating]
"""(K,) or (K, 3) float: spherical harmonics, index l(l+1) + m, positive signs."""

Transfer: TypeAlias = NDArray[np.float32]
"""(V, K) float32: what each vertex receives of each coefficient of the light."""
