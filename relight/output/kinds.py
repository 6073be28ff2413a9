"""What relight can write, by the word of `--format`, and how the files are named."""

FILES = {
    "glb": "relit.glb",
    "ply": "relit.ply",
    "npy": "radiance.npy",
    "splat": "relit_splat.ply",
    "albedo-splat": "albedo_splat.ply",
    "splat-glb": "relit_splat.glb",
    "usd": "relit_splat.usdc",
    "png": "preview.png",
}

OF_SPLATS = ("splat", "albedo-splat", "splat-glb", "usd")
"""Those that need the splat of the scene."""

HARMONICS = ("zero", "keep")
"""What becomes of an albedo splat's colour that depends on the view: reflected light of the capture, which goes."""

BAKED = ("texture", "transfer")
"""What `--bake` can make: textured meshes, and images of the transfer for shaders."""
