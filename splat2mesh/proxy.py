"""A simple mesh for collisions in engines, instead of the scene's mesh: one closed surface, or convex parts."""

from typing import Any

from numpy.typing import NDArray

from .base.errors import InputError
from .base.extras import needed
from .scene.glb import Glb
from .scene.scene import Scene
from .surface.wrap import closed_around, convex_parts

NODES = {"closed": "-colonly", "convex": "-convcolonly"}
"""Kind -> what Godot's importer makes a body for collisions of, by the end of a node's name."""

PACKAGES = {"closed": ("manifold3d",), "convex": ("manifold3d", "coacd")}


def check_proxy(kind: str | None) -> None:
    """Raise InputError for a kind that is not known, or whose packages are missing; None is no proxy."""
    if kind is None:
        return
    if kind not in NODES:
        raise InputError(f"`proxy` {kind}: expected one of {', '.join(NODES)}")
    for package in PACKAGES[kind]:
        needed(package, f"a {kind} proxy")


def add_proxy(scene: Scene, kind: str, seed: int = 0) -> None:
    """Add a proxy to a Scene that is not saved yet; `save` writes it as proxy.glb, in the scene frame. kind: "closed"
    or "convex". Far background takes no part. Raises InputError."""
    check_proxy(kind)
    eyes = scene.capture.get("eyes")
    bodies: list[tuple[NDArray[Any], NDArray[Any]]]
    if kind == "closed":
        vertices, triangles, voxel = closed_around(scene.vertices, scene.faces, eyes)
        bodies = [(vertices, triangles)]
    else:
        bodies, voxel = convex_parts(scene.vertices, scene.faces, eyes, seed=seed)
    scene.proxy = bodies_glb(bodies, NODES[kind])
    faces = sum(len(face) for _, face in bodies)
    statistics = {"proxy_bodies": len(bodies), "proxy_faces": faces, "proxy_voxel": voxel}
    scene.settings, scene.statistics = scene.settings | {"proxy": kind}, scene.statistics | statistics


def bodies_glb(bodies: list[tuple[NDArray[Any], NDArray[Any]]], suffix: str) -> bytes:
    """Bodies, vertices (V, 3) and faces (F, 3), as nodes proxy_000 and so on, whose suffix says to Godot what for."""
    file = Glb()
    for number, (vertices, faces) in enumerate(bodies):
        attributes = {"POSITION": file.positions(vertices)}
        file.mesh(f"proxy_{number:03d}{suffix}", attributes, indices=file.triangles(faces))
    return file.content()
