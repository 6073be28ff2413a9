"""The bundle that every loader reads: docs/live.md describes it."""

import json
import os
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from splat2mesh.base.arrays import Faces
from splat2mesh.base.version import VERSION
from splat2mesh.scene.folder import sha256_of
from splat2mesh.scene.glb import Glb
from splat2mesh.scene.mesh import vertex_normals
from splat2mesh.splats.formats import write_splats

from .ground import FILE as GROUND_FILE
from .lights import IMAGE, OfferedLight, rgbe
from .objects import FILE as OBJECTS_FILE
from .objects import MESH, MOVABLE_FILE
from .parts import FILE as PARTS_FILE
from .response import BANDS, SPREAD_BANDS
from .shine import FILE as GLOSS_FILE
from .surface import OWN_STEPS

if TYPE_CHECKING:
    from .lights import PortableLight
    from .live import Live

FORMAT, FORMAT_VERSION = "relight-live", 1

VERSION_OF_TERMS = 2
"""Version of a bundle with light beside the environment, which a reader of version 1 would not show."""

META = "live.json"

ROWS_FILE = "rows.bin"
"""The row of each splat in the source."""


def write_bundle(folder: str | os.PathLike[str], live: "Live", exact: bool = True) -> list[str]:
    """Write the files of a Live into an existing folder; return their names. exact: whether to write splat.ply too."""
    folder = Path(folder)
    splats = [f"splat.{kind}" for kind in ["compressed.ply"] + ["ply"] * exact]
    for name in splats:
        write_splats(folder / name, live.splats, name.removeprefix("splat."))
    contents = {name: content for name, content in _contents(live).items() if content is not None}
    movable = () if live.objects is None else live.objects.movable
    moved = {each.file_of_splats(k): each.splats for k, each in enumerate(movable) if each.splats is not None}
    lights: dict[str, PortableLight | OfferedLight] = dict(zip(light_files(live), live.lights, strict=True))
    lights |= dict(zip(offered_files(live), live.offered, strict=True))
    for name, content in contents.items():
        (folder / name).write_bytes(content)
    for name, moving in moved.items():
        write_splats(folder / name, moving, "compressed.ply")
    for name, light in lights.items():
        (folder / name).parent.mkdir(exist_ok=True)
        (folder / name).write_bytes(rgbe(light.image).tobytes())
    (folder / "proxy.glb").write_bytes(proxy_glb(*live.proxy))
    entries = [{"file": name, "sha256": sha256_of(folder / name), "count": len(live.splats)} for name in splats]
    (folder / META).write_text(json.dumps(described(live, entries), indent=1) + "\n", encoding="utf-8")
    return [META, *splats, *contents, *moved, *lights, "proxy.glb"]


def _contents(live: "Live") -> dict[str, bytes | None]:
    """The bytes of each file; None where a Live has none."""
    objects = live.objects
    movable = () if objects is None else objects.movable
    return {
        "transfer.bin": live.transfer.tobytes(),
        "surface.bin": live.surfaces.packed.tobytes(),
        "basis.bin": live.basis.tobytes(),
        ROWS_FILE: live.order.astype("<u4").tobytes(),
        "terms.bin": b"".join(term.tobytes() for term in live.terms) if live.terms else None,
        GLOSS_FILE: None if live.gloss is None else live.gloss.tobytes(),
        GROUND_FILE: None if live.ground is None else live.ground.tobytes(),
        PARTS_FILE: None if live.parts is None else live.parts.tobytes(),
        OBJECTS_FILE: None if objects is None else objects.tobytes(),
        MESH: None if objects is None else objects.glb or None,
        MOVABLE_FILE: b"".join(each.tobytes() for each in movable) if movable else None,
    }


def described(live: "Live", splats: list[dict[str, Any]]) -> dict[str, Any]:
    """Content of live.json: dict, JSON-clean. splats: list of dicts of file, sha256 and count."""
    clusters, weights, directions = live.basis.components.shape
    return {
        "format": FORMAT,
        "version": VERSION_OF_TERMS if live.terms else FORMAT_VERSION,
        "generator": f"relight {VERSION}",
        "count": len(live.splats),
        "order": "row i = splat i",
        "splats": splats,
        **{name: live.facts[name] for name in ("source", "frame", "camera")},
        "transfer": {"file": "transfer.bin", "bytes": 2 + weights, "weights": weights, "errors": live.errors},
        "basis": {
            "file": "basis.bin",
            "clusters": clusters,
            "weights": weights,
            "directions": directions,
            "direct": BANDS**2,
            "spread": SPREAD_BANDS**2,
            "lamps": 1,
        },
        "surface": {
            "file": "surface.bin",
            "bytes": 8,
            "lift": live.surfaces.lift,
            "own": live.surfaces.own.tolist(),
            "own_steps": OWN_STEPS,
        },
        **{name: live.facts[name] for name in ("mean", "brightness", "lamps")},
        **({"terms": [term.described() for term in live.terms]} if live.terms else {}),
        **({} if live.gloss is None else {"gloss": live.gloss.described()}),
        **({} if live.ground is None else {"ground": live.ground.described()}),
        **({} if live.parts is None else {"parts": live.parts.entries}),
        **({} if live.objects is None else {"objects": live.objects.described()}),
        "lights": [
            {
                "name": light.name,
                "file": file,
                "width": IMAGE[1],
                "height": IMAGE[0],
                "exposure": light.exposure,
                "mean": light.mean,
                "lamps": light.lamps,
                "rest": light.rest.tolist(),
                "whole": light.whole[: SPREAD_BANDS**2].tolist(),
                "suns": [
                    {"direction": each.tolist(), "weight": weight.tolist()}
                    for each, weight in zip(light.suns.directions, light.suns.weights, strict=True)
                ],
            }
            | ({"captured": light.captured, "unit": light.unit, "sky": light.sky} if live.terms else {})
            for file, light in zip(light_files(live), live.lights, strict=True)
        ],
        **({"offered": [*map(OfferedLight.described, live.offered, offered_files(live))]} if live.offered else {}),
        "proxy": {"file": "proxy.glb", "vertices": len(live.proxy[0]), "faces": len(live.proxy[1])},
    }


def light_files(live: "Live") -> list[str]:
    """Names of the lights' images."""
    return [f"lights/{number}.rgbe" for number in range(len(live.lights))]


def offered_files(live: "Live") -> list[str]:
    """Names of the images of likely lights of the capture."""
    return [f"lights/offered{number}.rgbe" for number in range(len(live.offered))]


def proxy_glb(vertices: NDArray[np.float32], faces: Faces, normals: bool = True) -> bytes:
    """The mesh under the splats, which occludes suns, blocks a walker and receives shadows: (V, 3) float32 in the scene
    frame and (F, 3), as one node of a binary glTF. normals: whether it has them."""
    file = Glb("relight")
    attributes = {"POSITION": file.positions(vertices)}
    if normals:
        attributes["NORMAL"] = file.values(vertex_normals(vertices, faces))
    file.mesh("proxy", attributes, indices=file.triangles(faces))
    return file.content()
