"""The register of outputs of relight, by the word of `--format`: their files, needs, options and writers."""

from typing import Any, NamedTuple

from splat2mesh.base.errors import InputError

from ..options import PICTURE_SIZE as PICTURE_SIZE


class Output(NamedTuple):
    """An output. file: its name. of_splats: whether it needs the splats of the scene. writer: what of `jobs.results`
    writes it and names its files; "" for `Results` itself. relit: whether it shows
    the splats, where there are any, in the new light. options: fields of the request that have a meaning with it alone.
    needs: a field without which it holds nothing, and why. of_parts: whether it can show a part of the scene in the new
    light."""

    file: str
    of_splats: bool = False
    writer: str = ""
    relit: bool = False
    options: tuple[str, ...] = ()
    needs: tuple[str, str] | None = None
    of_parts: bool = False


OUTPUTS = {
    "glb": Output("relit.glb", options=("live_mesh",), of_parts=True),
    "ply": Output("relit.ply", of_parts=True),
    "npy": Output("radiance.npy", of_parts=True),
    "splat": Output("relit_splat.ply", True, relit=True, of_parts=True),
    "albedo-splat": Output("albedo_splat.ply", True, "engines"),
    "splat-glb": Output("relit_splat.glb", True, "engines", True, of_parts=True),
    "usd": Output("relit_splat.usdc", True, "engines", True),
    "png": Output("preview.png", relit=True, of_parts=True),
    "live": Output("live/live.json", True, "live"),
    "web": Output("relit.html", True, "live"),
    "probe": Output("probe.exr", True, "around", True, ("probe_at", "probes")),
    "catcher": Output(
        "catcher.ply",
        True,
        "around",
        True,
        needs=("inserted", "it holds the change that objects make; give an object, as `inserted`"),
    ),
    "clean-splat": Output("clean_splat.ply", True, "clean", of_parts=True),
    "passes": Output("passes.exr", False, "passes", options=("cameras", "color_space")),
}

FILES = {word: each.file for word, each in OUTPUTS.items()}


def kinds_with(option: str) -> tuple[str, ...]:
    """Return the words of the outputs for which a field of the request has a meaning; none where it has one anyway."""
    return tuple(word for word, each in OUTPUTS.items() if option in each.options)


def check_parts(request: Any) -> None:
    """Raise InputError where a request has a part, in `only`, `keep` or `parts`, and something that is of the whole
    scene."""
    name = next((name for name in ("keep", "only", "parts") if getattr(request, name)), "")
    if request.shadow_of_parts and name in ("", "parts"):
        raise InputError("`shadow_of_parts`: it is of a part; give `only` or `keep`")
    if not name:
        return
    whole = [f"`{each}`" for each in ("inserted", "animated", "live_mesh") if getattr(request, each)]
    whole += [f"`formats` {word}" for word in request.formats or () if word in OUTPUTS and not OUTPUTS[word].of_parts]
    if whole:
        raise InputError(f"{whole[0]}: it is of the whole scene in one light; leave it or `{name}` out")


AROUND, WITHOUT_LIGHT = (
    tuple(word for word, each in OUTPUTS.items() if each.writer == writer) for writer in ("around", "clean")
)
"""Kinds with the surrounding light; that do not depend on the light."""

OF_SPLATS = tuple(word for word, each in OUTPUTS.items() if each.of_splats)
"""Kinds that need the splats of the scene."""

DEFAULT_KINDS = ("glb", "png")
"""Default outputs; with a splat, the relit splat too."""

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
