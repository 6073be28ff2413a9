"""The outputs of relight, by the word of `--format`, and the names of their files."""

FILES = {
    "glb": "relit.glb",
    "ply": "relit.ply",
    "npy": "radiance.npy",
    "splat": "relit_splat.ply",
    "albedo-splat": "albedo_splat.ply",
    "splat-glb": "relit_splat.glb",
    "usd": "relit_splat.usdc",
    "png": "preview.png",
    "live": "live/live.json",
    "web": "relit.html",
    "probe": "probe.exr",
    "catcher": "catcher.ply",
    "clean-splat": "clean_splat.ply",
    "passes": "passes.exr",
}

FOR_ENGINES = ("albedo-splat", "splat-glb", "usd")
"""Kinds that `engine_files.EngineFiles` writes."""

AROUND = ("probe", "catcher")
"""Kinds with the surrounding light and the changes that objects make; `around_files.AroundFiles` writes them."""

WITHOUT_LIGHT = ("clean-splat",)
"""Kinds that do not depend on the light; `clean_files.CleanFiles` writes them."""

APART = ("live", "web", "passes", *FOR_ENGINES, *AROUND, *WITHOUT_LIGHT)
"""Kinds with a separate writer, which names its files."""

OF_SPLATS = ("splat", "live", "web", *FOR_ENGINES, *AROUND, *WITHOUT_LIGHT)
"""Kinds that need the splats of the scene."""

CITY_FILES = ("glb", "ply", "npy", "splat", "sog")
"""The formats of a tile of a city; sog is one streamed SOG of all."""

HARMONICS = ("zero", "keep")
"""Treatments of an albedo splat's view-dependent colour: it is reflected light of the capture, which is removed."""

COLOR_SPACES = ("srgb", "acescg")
"""In which passes are written, linear both."""

SUN = "sun"
"""The pass that is a part of direct light."""

BAKED = ("texture", "transfer")
"""The outputs of `--bake`: textured meshes, and images of the transfer for shaders."""

SHEET = "sheet.png"
"""The picture with all lights."""
