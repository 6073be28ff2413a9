"""The accepted values of settings, defined once for the library, its requests and both command lines. Imports nothing
heavy."""

from collections.abc import Iterable
from typing import Any

from .errors import InputError
from .specs import meant

UP_CHOICES = ("auto", "+y", "-y", "+z", "-z")
"""Which axis of the splat points up."""

DETAIL_CHOICES = ("draft", "normal", "fine")
"""Number of views for the surface, and size of its voxels."""

SURFACE_CHOICES = ("field", "sugar")
"""A level of the opacity field, or the density level set and Poisson surface of the SuGaR paper."""

BACKGROUND_CHOICES = ("cut", "keep")
"""Treatments of a far background: a shell of it around the scene would block all new light."""

STAND_CHOICES = ("auto", "inside", "outside")
"""From where the scene was captured."""

PROXY_CHOICES = ("closed", "convex")
"""Kinds of collision proxy: one closed surface, or convex parts."""

FOLIAGE_CHOICES = ("mesh", "cards", "none")
"""Leaves and grass in the mesh: faces like all else, small quads in their place, or left out."""

DEFAULT_VERTICES = 50_000
"""Vertices of an object. A place gets as many as it needs, but no fewer."""

MOST_STEPS = 10_000
"""Angles, or times of a day, in one call."""

DEFAULT_FPS = 24.0
"""Frames a second of films and of sequences that play."""

DEFAULT_MAX_VERTICES = 40_000
"""Vertices per chunk: the limit of the Neural-GASh paper."""

SMALLEST_TEXTURE, LARGEST_TEXTURE = 16, 8192
"""Sides of a texture, in texels. Graphics cards take 8192; below 16 the gutters leave no room for charts."""

MOST_SEED = 2**64


def check_choice(name: str, value: Any, choices: Iterable[str]) -> Any:
    """Return the choice that a value names, in any case. Raises InputError, which names the setting, for any other."""
    known = {choice.lower(): choice for choice in choices}
    word = value.lower() if isinstance(value, str) else value
    if word not in known:
        raise InputError(f"`{name}` {value}: expected one of {' '.join(known.values())}{meant(str(word), known)}")
    return known[word]


def several(name: str, values: Iterable[str], choices: Iterable[str]) -> tuple[str, ...]:
    """Return the choices that words name, also with commas between them; each once, in order. Raises InputError."""
    choices = list(choices)
    words = [word for value in values for word in value.split(",") if word]
    if values and not words:
        raise InputError(f"`{name}`: expected some of {' '.join(choices)}")
    return tuple(dict.fromkeys(check_choice(name, word, choices) for word in words))


def check_lod(lod: Any) -> int | str:
    """Return a level of detail as "auto" or a number. Raises InputError for anything else."""
    if lod == "auto" or (type(lod) is int and lod >= 0):
        return lod
    if isinstance(lod, str) and lod.isdecimal():
        return int(lod)
    raise InputError(f"`lod` {lod}: expected auto or the number of a level, 0 being the finest")


def check_texture(texture: Any) -> int | str:
    """Return the side of a texture as "auto", "none" or a number. Raises InputError for anything else."""
    if texture in ("auto", "none"):
        return str(texture)
    if isinstance(texture, str) and texture.isdecimal():
        texture = int(texture)
    if type(texture) is int and SMALLEST_TEXTURE <= texture <= LARGEST_TEXTURE:
        return texture
    raise InputError(
        f"`texture` {texture}: expected auto, none or a number of texels from {SMALLEST_TEXTURE} to {LARGEST_TEXTURE}"
    )


def check_seed(seed: Any) -> int:
    """Return a seed as an int. Raises InputError for one that the random generators do not take."""
    if seed != int(seed) or not 0 <= seed < MOST_SEED:
        raise InputError(f"`seed` must be a whole number from 0 to 2^64 - 1, found {seed}")
    return int(seed)
