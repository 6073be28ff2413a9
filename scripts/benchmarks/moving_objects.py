"""The shadow of a ball that is moved on a generated table top, as a session draws it, against the exact one.

`shadow` and `correlation` compare logarithms of the ratio with / without the ball, over the vertices that it changes by
more than 5% in the exact result: 1 is right. Milliseconds are of the processor, the median of some positions.
"""

import time
from dataclasses import replace

import numpy as np

from benchmarks.inserts import SIZE, ball_object
from benchmarks.shapes import shape
from relight import RelightRequest
from relight.insert.asked import AskedInsert
from relight.jobs.job import Job
from relight.light.environment import Environment
from splat2mesh.scene.color import bytes_from_unit, luminance, srgb_from_linear
from splat2mesh.scene.mesh import Mesh
from splat2mesh.scene.scene import Scene

QUICK = ["--vertices", "3000", "--lights", "overcast", "--positions", "2"]
AWAY = (0.0, 0.05, 0.15)
"""Distances from the last rest, in diagonals of the scene."""


def arguments(parser):
    parser.add_argument("--vertices", type=int, default=40_000, metavar="N", help="of the table top")
    parser.add_argument("--lights", nargs="+", default=["overcast", "studio", "sunset"])
    parser.add_argument("--positions", type=int, default=20, metavar="N", help="that are timed")


def run(options, report):
    columns = dict.fromkeys(("away", "shadow", "correlation"), ".2f")
    table = report.table("shadow of a moved ball", light="<10", **columns, milliseconds=".1f")
    mesh = shape("tabletop", options.vertices)
    for name in options.lights:
        for row in rows(mesh, Environment.load(name), options.positions):
            table.add(light=name, **row)


def rows(mesh, light, positions):
    """Errors of the moved shadow at some distances, and its time."""
    scene = Scene([Mesh(mesh.vertices, mesh.normals, mesh.faces, bytes_from_unit(srgb_from_linear(mesh.albedo)))])
    low, high = scene.bounds
    middle = 0.5 * (low + high)
    asked = AskedInsert(ball_object(SIZE * scene.diagonal), (middle[0], float(high[1]), middle[2]), on="floor")
    known = {"inserted": (asked,), "caching": "none", "formats": ("npy",)}
    rest = next(Job(RelightRequest(scene, light, albedo=mesh.albedo, **known)).shaded()).inserted

    def at(away):
        x, y, z = asked.at
        return rest.inserts.moved((replace(asked, at=(x + away * scene.diagonal, y, z)),))

    spent = []
    for away in np.linspace(*AWAY[1:], positions):
        inserts, start = at(away), time.process_time()
        inserts.glimpse(rest).ratio  # noqa: B018 - computed here
        spent.append(time.process_time() - start)
    for away in AWAY:
        exact, found = at(away).under(rest.around, rest.received).ratio, at(away).glimpse(rest).ratio
        truth, ours = (np.log(luminance(each)) for each in (exact, found))
        seen = np.abs(truth) > 0.05
        error = np.sqrt(np.square(ours - truth)[seen].mean() / np.square(truth)[seen].mean())
        yield {
            "away": away,
            "shadow": 1.0 - error,
            "correlation": np.corrcoef(ours[seen], truth[seen])[0, 1],
            "milliseconds": 1e3 * np.median(spent),
        }
