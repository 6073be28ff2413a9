"""Results in files: meshes, textures, pictures."""
