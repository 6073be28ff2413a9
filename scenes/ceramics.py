"""A table with glazed, metal and matte objects of known reflectance and roughness."""

from dataclasses import dataclass

import numpy as np

from splat2mesh.base.errors import InputError

from . import albedo, shapes
from .kinds import BOWL, COLUMN, SINK, VASE, SceneTruth, placed

SIZE = 2.2
"""Side of the table top; what stands on it takes up most of the pictures."""

METALS = np.array([[0.95, 0.74, 0.38], [0.9, 0.6, 0.48], [0.56, 0.57, 0.58], [0.91, 0.92, 0.92]])
"""Linear reflectance at normal incidence of gold, copper, steel and aluminium."""

GLAZE = (0.035, 0.06)
"""Range of the reflectance of glazes and varnishes: refractive index 1.46 to 1.65."""

GLAZE_ALPHA, METAL_ALPHA = (0.06, 0.3), (0.12, 0.4)
"""Ranges of the roughness of GGX, even in the logarithm: wet glaze to eggshell, polished to brushed."""


@dataclass(frozen=True)
class GlossyTruth(SceneTruth):
    """A scene with known gloss. albedo_linear is the diffuse reflectance: 0 on metals.

    reflectance: (V, 3) float32 at normal incidence, 0 on matte parts. alpha: (V,) float32 roughness of GGX, 1 on what
    is matte. metal: (V,) bool.
    """

    reflectance: np.ndarray
    alpha: np.ndarray
    metal: np.ndarray

    @property
    def glossy(self):
        """(V,) bool: whether anything mirrors."""
        return self.reflectance.any(axis=1)


def ceramics(seed=0, vertices=20_000, glossy=True):
    """The table of a seed with about `vertices` vertices: a GlossyTruth.

    The seed changes places, proportions, colours, reflectances and roughnesses, never the list of solids: slab, glazed
    ball, vase and column, a metal ring and bowl, a matte blob and box. glossy: without it, glazes are left off and
    metals are painted; all else stays. Raises InputError for fewer than 1,000 vertices.
    """
    if vertices < 1000:
        raise InputError(f"--vertices {vertices}: expected at least 1000, fewer cannot show the shapes")
    edge = 0.1
    for _ in range(3):
        edge *= np.sqrt(sum(len(points) for (points, _, _), _ in _things(seed, edge)) / vertices)
    things = _things(seed, edge)
    if not glossy:
        things = [((*solid[:2], _painted(solid[2], paint)), MATTE) for solid, (_, _, paint) in things]
    base = SceneTruth.of_solids("ceramics", seed, [solid for solid, _ in things])
    reflectance = np.array([np.broadcast_to(each, 3) for _, (each, _, _) in things], np.float32)[base.part]
    alpha = np.array([each for _, (_, each, _) in things], np.float32)[base.part]
    metal = reflectance.any(axis=1) & ~base.albedo_linear.any(axis=1)
    return GlossyTruth(*vars(base).values(), reflectance, alpha, metal)


MATTE = 0.0, 1.0, None


def _painted(color, paint):
    """The colours (V, 3) of a solid, or those of its paint if it has none."""
    return color if paint is None else np.broadcast_to(paint, color.shape)


def _things(seed, edge):
    """Solids, each with (reflectance, alpha, paint of a metal where it must be matte)."""
    rng = np.random.default_rng([seed, 31])
    slab, slab_faces = placed(shapes.rounded_box((SIZE, 0.12, SIZE), 0.04, edge), (0, -0.06, 0))
    things = [((slab, slab_faces, albedo.patches(slab, albedo.random_colors(rng, 30), rng)), MATTE)]
    colors = albedo.random_colors(rng, 14)

    def glazed():
        return rng.uniform(*GLAZE), np.exp(rng.uniform(*np.log(GLAZE_ALPHA))), None

    metals = rng.permutation(len(METALS))

    def metallic(number):
        return METALS[metals[number]], np.exp(rng.uniform(*np.log(METAL_ALPHA))), colors[12 + number]

    column = placed(shapes.turned(COLUMN, edge), (rng.uniform(-0.05, 0.05), -SINK, 0.0))
    things.append(((*column, albedo.mottled(column[0], colors[0], rng, 0.2)), glazed()))
    radius = rng.uniform(0.26, 0.32)
    ball = shapes.blob(radius, 0.12, rng, edge)
    box = shapes.rounded_box(rng.uniform(0.3, 0.42, 3), 0.04, edge)
    around = [
        (ball, 0.9 * radius, glazed(), lambda at: albedo.mottled(at, colors[1], rng, 0.25)),
        (shapes.turned(VASE, edge), 0.0, glazed(), lambda at: albedo.stripes(at, colors[2:4], (0.2, 1, 0), 0.2)),
        (shapes.torus(0.24, 0.11, edge), 0.11, metallic(0), np.zeros_like),
        (shapes.turned(BOWL, edge), 0.0, metallic(1), np.zeros_like),
        (shapes.blob(0.24, 0.3, rng, edge), 0.2, MATTE, lambda at: albedo.patches(at, colors[4:8], rng)),
        (box, None, MATTE, lambda at: albedo.checker(at, colors[8:10], 0.13)),
    ]
    places = rng.permutation(len(around)) + rng.uniform(-0.08, 0.08, len(around)) + rng.uniform()
    for (solid, height, gloss, paint), place in zip(around, places * 2 * np.pi / len(around), strict=True):
        height = -solid[0][:, 1].min() if height is None else height
        points, faces = placed(solid, (0.74 * np.cos(place), height - SINK, 0.74 * np.sin(place)), rng.uniform(0, 360))
        things.append(((points, faces, paint(points)), gloss))
    return things
