"""The summary of a written scene."""

from pathlib import Path

from .base.choices import DEFAULT_VERTICES
from .scene.folder import PICTURE, PROXY, TEXTURED
from .scene.scene import Scene
from .surface.wrap import FARTHEST

FEWER = 1.1
"""Requested vertices per vertex of the mesh above which the summary says that the surface has no more."""


def summary_of(scene: Scene, output: Path, seconds: float | None = None) -> list[str]:
    """Return its size, and what decided which way is up."""
    counts, took = scene.statistics, "" if seconds is None else f", {seconds:.1f} s"
    level = f" of level {scene.source['lod']}" if "lod" in scene.source else ""
    chunks = len(scene.chunks) - len(scene.hull) + len(scene.cards)
    lines = [
        f"{output}: {counts['vertices']:,} vertices, {counts['faces']:,} faces in {chunks} chunks, "
        f"from {counts['splats']:,} splats{level}{took}"
    ]
    wanted = scene.settings.get("vertices")
    if isinstance(wanted, int) and wanted > max(DEFAULT_VERTICES, FEWER * counts["vertices"]):
        finer = "" if scene.settings.get("detail") == "fine" else "; a finer --detail finds more"
        lines.append(f"  --vertices {wanted:,}: the surface has fewer{finer}")
    objects = scene.settings.get("objects") or {"": scene.settings}
    for name, settings in objects.items():
        if settings.get("up_from", "asked for") != "asked for":
            lines.append(f"  up{f' of {name}' if name else ''}: {settings['up_from']} (--up overrules)")
    return lines


def extras_of(scene: Scene, output: Path) -> list[str]:
    """Return what else lies in the folder: its picture, its texture and its proxy."""
    lines = [f"  {output / PICTURE} shows splat and mesh"] * (scene.picture is not None)
    if scene.textured is not None:
        side, size = scene.statistics["texture_size"], len(scene.textured) / 1e6
        lines.append(f"  {output / TEXTURED}: the mesh in a texture of {side} x {side} texels, {size:.1f} MB")
    if scene.hull:
        counts = scene.statistics
        instead = f"{counts['cards']:,} cards in their place" if scene.cards else "nothing in their place"
        lines.append(f"  leaves: {counts['faces_leaves']:,} faces left out, {instead}")
    kind = scene.settings.get("proxy")
    if kind:
        counts = scene.statistics
        named = "one closed surface" if kind == "closed" else f"{counts['proxy_bodies']} convex parts"
        within = FARTHEST * counts["proxy_voxel"]
        lines += [f"  {output / PROXY}: {named} of {counts['proxy_faces']:,} faces, within {within:.2g} of the mesh"]
    return lines
