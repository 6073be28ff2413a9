"""Relit splats: each Gaussian takes the light ratio at its place on the mesh.

binding = Binding(splats, scene)
write_relit_ply("relit_splat.ply", binding.relit(before, after), "point_cloud.ply")
"""

from .albedo import albedo_splats, normals_of
from .binding import Binding
from .sky import SKIES, shown_as_sky
from .write import write_relit_ply

__all__ = ["SKIES", "Binding", "albedo_splats", "normals_of", "shown_as_sky", "write_relit_ply"]
