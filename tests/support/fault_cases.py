"""Commands on small scenes that write every kind of result: what faults are put into. See `fault_runs`."""

import numpy as np
from attack_samples import _meshes
from fault_runs import Case
from lit_ball import TILT, ball_scene, splats_of_ball

from relight.cli import main
from splat2mesh.scene.scene import Scene
from splat2mesh.scene.sources import describe
from splat2mesh.splats.formats import read_splats, write_inria_ply

LIGHT = ("--env", "noon", "--bands", "2", "--rays", "4", "--effects", "shadows", "--albedo", "captured", "-o", "out")

CASES = {
    "mesh": Case("splat2mesh", ("ball.ply", "-o", "out", "--overwrite"), ("out",)),
    "new": Case("relight", ("scene", *LIGHT, "--format", "glb", "npy"), ("out",)),
    "light": Case("relight", ("scene", *LIGHT, "--format", "glb", "npy", "--overwrite"), ("out",)),
    "more": Case("relight", ("scene", *LIGHT, "--format", "glb", "npy"), ("out",)),
    "files": Case(
        "relight",
        ("scene", *LIGHT, "--format", "ply", "splat", "live", "web", "splat-glb", "albedo-splat", "--overwrite"),
        ("out",),
    ),
    "angles": Case(
        "relight",
        ("scene", *LIGHT, "--rotate", "0:90:90", "--sheet", "--format", "npy", "--overwrite"),
        ("out/noon_0", "out/noon_90", "out/sheet.png"),
    ),
    "film": Case("relight", ("moving.glb", *LIGHT, "--animate", "--fps", "1", "--overwrite"), ("out",)),
}
"""new: nothing stands at the output; more: results of the same settings do, and are added to; the others replace what
does."""


def made(folder, name):
    """A new folder with what a case reads and, where it replaces something, an older result."""
    folder.mkdir(parents=True)
    case = CASES[name]
    write_inria_ply(folder / "ball.ply", splats_of_ball(300)[0])
    if case.command == "splat2mesh":
        scene_of("ball.ply", folder).save(folder / "out")
    elif name == "film":
        files, entry = _meshes(folder)["animation"]
        (folder / "moving.glb").write_bytes(files[entry])
    else:
        scene_of("ball.ply", folder).save(folder / "scene")
    if name == "more":
        main([str(folder / "scene"), *LIGHT, "-o", str(folder / "out"), "--format", "ply", "-q"])
        (folder / "out" / "old.txt").write_text("{}")
    for output in case.outputs if case.command == "relight" and name not in ("new", "more") else ():
        if "." not in output:
            (folder / output).mkdir(parents=True)
            for old in ("report.json", "0000.png", "old.txt"):
                (folder / output / old).write_text("{}")
    return folder


def scene_of(path, folder=".", picture=None, **_):
    """A Scene as `convert` makes of a splat: it is read, but the mesh is known, as are the times and the picture."""
    read_splats(folder / path if folder != "." else path)
    ball, _ = ball_scene(6)
    return Scene(
        ball.chunks,
        scene_from_splat=TILT,
        background=ball.chunks[:1],
        background_splats=np.arange(3),
        source=describe(folder / path if folder != "." else path),
        statistics={"vertices": ball.vertex_count, "faces": len(ball.faces), "splats": 300},
        picture=np.zeros((8, 8, 3), np.uint8),
        proxy=b"proxy" if picture is None else None,
    )
