"""Transfer with shadows: the visibility of the whole scene, ray traced."""

from splat2mesh.base.arrays import Transfer
from splat2mesh.base.progress import Advance

from ..sh import harmonics
from .occluder import Occluder
from .visibility import Visibility


def raytraced_scene(
    occluder: Occluder,
    bands: int,
    rays: int,  # per vertex
    seed: int = 0,
    advance: Advance = lambda count: None,  # called with the number of vertices done
) -> Transfer:
    """Transfer of all white vertices in the shadow of everything: (V, K) float32.

    Cosine-distributed rays about the normals, with a linear model of the visibility as control variate
    (`sampling.gather`), whose noise is averaged over neighbouring vertices with the same shadows (`filtering`): at 8
    rays the error is 2.5 times smaller than without, at 64 rays 1.6 times. Exact for what nothing hides, and exactly 0
    where a vertex and all around it see no sky. Surfaces hide light from both sides, so a vertex whose normal points
    into a closed body is black. Vertices of equal position and normal get equal rows. A row depends on the vertex, the
    seed and the scene, but on no order of vertices or faces and on no division into chunks.
    Raises InputError for bands outside 1..10 and rays outside 1..65536.
    """
    harmonics.check_bands(bands)
    return Visibility(occluder, rays, seed, advance=advance).transfer(bands)
