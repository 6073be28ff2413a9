"""What relight can write, by the word of `--format`, and how the files are named."""

FILES = {
    "glb": "relit.glb",
    "ply": "relit.ply",
    "npy": "radiance.npy",
    "splat": "relit_splat.ply",
    "png": "preview.png",
    "live": "live/live.json",
    "web": "relit.html",
}

OF_SPLATS = ("splat", "live", "web")
"""Those that need the splats that the scene was made from."""

BAKED = ("texture", "transfer")
"""What `--bake` can make: textured meshes, and images of the transfer for shaders."""
