"""Radiance transfer: how every vertex of a white scene receives light from every direction.

A transfer is (V, K) float32, K = B^2 coefficients in the basis of `relight.sh.harmonics`; the exit radiance of a
white diffuse vertex is its row times the light's coefficients. It includes Lambert's A_l / pi, so under
a constant sky of radiance 1 an unoccluded vertex gives exactly 1. This module imports nothing heavy.
"""

from splat2mesh.base.errors import InputError

METHODS = ("auto", "raytraced", "neural-gash", "analytic", "blinn-phong")

DEFAULT_BANDS = 8
DEFAULT_RAYS = 128
"""With suns split off, errors against the full HDRI of .2 to .8% on three scenes under four lights; 10 bands and 256
rays are at .1 to .7% for nearly twice the time, 5 bands and 64 rays at .3 to 1.7% for half of it (docs/light.md)."""

FEW_BANDS = 3
"""Bands that shaders of other programs, pictures and the network of "neural-gash" hold: nine numbers. An unshadowed
diffuse surface gets 1% of its brightness from higher ones (Ramamoorthi, Hanrahan 2001); what shadows add in them is
lost."""

MAX_RAYS = 2**16
"""Rays per vertex beyond which float32 sums, not the rays, limit the accuracy."""


def check_rays(rays: int) -> int:
    """Return `rays` as an int. Raises InputError unless it is a whole number from 1 to MAX_RAYS."""
    if rays != int(rays) or not 1 <= rays <= MAX_RAYS:
        raise InputError(f"`rays` per vertex must be a whole number from 1 to {MAX_RAYS}, found {rays}")
    return int(rays)
