"""How a scene is lit: the method and its numbers, as planned, forced, cached and reported."""

from typing import NamedTuple

SHADOWS, SUN, BOUNCES, VOLUME = EFFECTS = ("shadows", "sun", "bounces", "volume")
"""shadows: everything hides light from everything. sun: light too concentrated for spherical harmonics shines as single
directions, traced again for every light and angle. bounces: light that surfaces send to one another, by their albedo.
volume: leaves and grass have no normal, and light reaches them through one another (`volume.Foliage`)."""

BOUNCE_RAYS = 64
"""Without a plan. Error of bounced light against a path tracer, of all light, on a tabletop whose bounces are
26% of it (`scripts/bench bounces`): 16 rays 2.7%, 32 1.8%, 64 1.3%, 128 1.1%, 256 1.0%. The direct light of 10 bands is
3 to 4% off by itself."""

VOLUME_DIRECTIONS, VOLUME_ERROR = 512, 0.016
"""Directions from which light comes to leaves and grass, and how far off it is with so many, relative: the worst of six
lights without their suns in a generated garden, against 2,048. With 256 it is .026, with 1,024 .010."""

BOUNCE_TOLERANCE = 1e-3
"""Contribution below which further bounces are dropped where nothing is planned: well below the error of the rays. A
tabletop reaches it in six bounces, an object in three."""


GLOSS = "gloss"
"""Reflections of splats, which move with the light: no part of the light on the mesh, and of no Settings."""


class Settings(NamedTuple):
    """One way to light a scene.

    method: one of `transfer.METHODS` but "auto". bands: SH bands. rays: per vertex, 0 where none are traced.
    sun_tolerance: estimated error that the split of the sun may leave; 0 for no split.
    bounce_rays: rays per vertex that carry light from surface to surface; 0 for none.
    bounce_tolerance: what bounces still to come may contribute, relative, when they stop.
    volume: directions from which light comes to leaves and grass; 0 where they are surfaces like all else.
    """

    method: str
    bands: int
    rays: int = 0
    sun_tolerance: float = 0.0
    bounce_rays: int = 0
    bounce_tolerance: float = 0.0
    volume: int = 0

    @property
    def effects(self) -> frozenset[str]:
        """The names of EFFECTS that it has."""
        has = {SHADOWS: self.rays, SUN: self.sun_tolerance, BOUNCES: self.bounce_rays, VOLUME: self.volume}
        return frozenset(name for name, there in has.items() if there)

    def __str__(self) -> str:
        parts = [self.method, f"{self.bands} bands"]
        if self.rays:
            parts.append(f"{self.rays} rays")
        if self.sun_tolerance:
            parts.append("suns")
        if self.bounce_rays:
            parts.append(f"bounces ({self.bounce_rays} rays)")
        if self.volume:
            parts.append(f"volume ({self.volume} directions)")
        return ", ".join(parts)
