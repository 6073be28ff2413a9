"""Textures of meshes: charts, the texels of a surface, and the colours that views of splats show there."""
