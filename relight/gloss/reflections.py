"""New reflections for relit splats: harmonics of degree 3, fitted to pictures whose pixels mirror the new light.

A single Gaussian's harmonics are noise; together, in a picture, they show the reflection. So the old reflection is
removed from pictures and the new one added, and the harmonics of glossy Gaussians follow by least squares.
"""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from splat2mesh.base.arrays import Floats, Matrix3, Matrix4
from splat2mesh.scene.color import linear_from_srgb, srgb_from_linear
from splat2mesh.splats.splats import Splats

from ..lamps.emitters import Emitters
from ..splats.binding import Binding
from ..splats.looks import Looks
from ..transfer.occluder import Frame
from .harmonicsfit import fitted
from .lamp_lobes import lamp_lobes
from .material import Gloss
from .mirrored import MirroredPixels
from .pixels import SurfacePixels

DEGREE = 3
"""Largest degree of written harmonics, as viewers draw no more."""

MOSTLY = 0.5
"""Least glossy share of a Gaussian's nodes for it to take part."""


class Reflections:
    """Reflections on the splats of a Binding, whose light may change; what depends on geometry alone is traced once.

    looks: at the splats. gloss: of the nodes. scene: (3, 3) rotation from the frame of the splat into the scene's.
    """

    def __init__(self, binding: Binding, looks: Looks, gloss: Gloss, scene: Matrix3) -> None:
        self._binding, self._means = binding, binding.drawn(binding.splats.means)
        seen = (SurfacePixels.of_view(looks, binding.surface, number) for number in range(len(looks.eyes)))
        self._views = [MirroredPixels.of(pixels, binding.surface, gloss, scene) for pixels in seen]
        places = binding.places
        share = np.einsum("nk,nk->n", places.weights, gloss.glossy[places.columns])
        glossy = (share > MOSTLY) & (places.far < MOSTLY)
        rows = np.zeros(len(binding.lit), bool)
        rows[np.flatnonzero(binding.lit)[glossy]] = True
        part = binding.drawn(rows.astype(np.float32))
        self._glossy = np.flatnonzero(part > MOSTLY)  # among those drawn

    def reflected(self, light: Floats, radiance: Floats) -> list[NDArray[np.float64]]:
        """The light that the glossy pixels of each view mirror, (Q, 3) each: `MirroredPixels.reflected`, radiance
        (V, 3) of the vertices."""
        nodes = self._binding.surface.of_vertices(np.asarray(radiance, np.float32))
        return [view.reflected(light, nodes) for view in self._views]

    def pictures(self) -> list[NDArray[np.float32]]:
        """The splats as captured, (P, 3) display values of each view."""
        each, sh = (view.pixels for view in self._views), self._binding.drawn(self._binding.splats.sh)
        return [pixels.blending.drawn_toward(self._means, sh, pixels.eye) for pixels in each]

    def shining(self, emitters: Emitters, frame: Frame, scene_from_splat: Matrix4) -> list[NDArray[np.float64]]:
        """The highlights of emitters on the same pixels: `lamp_lobes`."""
        asked = self._binding.surface, emitters, frame, scene_from_splat
        return [lamp_lobes(view, *asked) for view in self._views]

    def relit(
        self,
        splats: Splats,
        log_gain: NDArray[np.float32],
        before: list[NDArray[np.float64]],
        after: list[NDArray[np.float64]],
    ) -> Splats:
        """Relit splats with the new reflections in the place of the old ones.

        splats: as `Binding.relit` gives them, all that the file has. log_gain: (M, 3) of the nodes, by which it relit
        them. before, after: what is mirrored in the light of the capture and in the new one, of `reflected`, in
        display units. Where both are equal, after that gain, no bit changes.
        """
        shown, means, errors = self._binding.drawn(splats.sh), self._means, []
        for view, old, new in zip(self._views, before, after, strict=True):
            picture = view.blending.drawn_toward(means, shown, view.pixels.eye)
            now = np.maximum(picture[view.pixels.known], 0.0).astype(np.float64)
            ratio = np.exp(2.4 * view.pixels.of_nodes(log_gain))
            change = new - ratio * old
            linear = linear_from_srgb(now)
            wanted = srgb_from_linear(np.maximum(linear + change, 0.0))
            wanted = np.minimum(wanted, np.maximum(now, 1.0))
            error = np.zeros_like(picture)
            error[view.pixels.known] = np.where(change == 0.0, 0.0, wanted - now)
            errors.append(error)
        if not any(error.any() for error in errors):
            return splats
        parts = [(view.blending, view.pixels.known, view.pixels.eye) for view in self._views]
        found = fitted(means, self._glossy, parts, errors, DEGREE)
        number = np.full(len(means), -1)
        number[self._glossy] = np.arange(len(found))
        number = self._binding.sketch.members(number)
        sh = np.zeros((len(splats), (DEGREE + 1) ** 2, 3), np.float32)
        sh[:, : splats.sh.shape[1]] = splats.sh
        sh[self._binding.drawn_rows[number >= 0]] += found[number[number >= 0]]
        return replace(splats, sh=sh)
