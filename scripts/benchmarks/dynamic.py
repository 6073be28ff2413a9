"""Latencies of the engine that follows moving light, albedo and meshes, and what deforming meshes cost.

1 product     one light times a transfer, against copying as many bytes in the same run, and BLAS
2 latencies   median and 95% of: rotate (harmonics turned, product), swap (a light projected again, product), albedo
              (product times another albedo), one chunk of ten deformed (update of the transfer, product)
3 deforming   milliseconds a frame of a mesh that twists, bends, or reaches over a table, by method, and the error of
              its radiance against a full computation with 512 rays a vertex in the same bands
Times are wall-clock ms, in brackets processor ms: on a machine shared with others the second say more.
"""

import sys

import numpy as np

from benchmarks.harness import relative_error, timed
from relight import Environment
from relight.animation.animation import face_normals
from relight.transfer.analytic import analytic
from relight.transfer.apply import BlockTransfer
from relight.transfer.dynamic import DynamicTransfer
from splat2mesh.scene.mesh import Mesh
from splat2mesh.scene.scene import Scene

REFERENCE_RAYS = 512
CHUNKS = 10
QUICK = ["--vertices", "2000", "--deform", "1000", "--frames", "2"]
TRIES = 60
"""Runs, of which the fastest counts: both threads of a product need a free core at once."""
METHODS = (
    ("exact", 8, 128),
    ("exact", 5, 64),
    ("exact", 3, 32),
    ("exact", 3, 8),
    ("analytic", 3, 0),
)
DEFORMATIONS = "twist", "bend", "arm over a table"


def measured(work, repeats):
    """Median and 95% of wall-clock ms, and the median of processor ms."""
    runs = [timed(lambda s=step: work(s)) for step in range(repeats)]
    wall, cpu = (1e3 * np.array([getattr(run, key) for run in runs]) for key in ("wall", "cpu"))
    return float(np.median(wall)), float(np.percentile(wall, 95)), float(np.median(cpu))


def shown(times, digits=1):
    return f"{times[0]:.{digits}f}, {times[1]:.{digits}f} ({times[2]:.{digits}f})"


def sheet(along, across):
    """Vertices of a sheet in the unit square of the plane y = 0, (N, 3) float32, and its faces."""
    x, z = np.meshgrid(np.linspace(0, 1, along), np.linspace(0, 1, across), indexing="ij")
    index = np.arange(along * across).reshape(along, across)
    a, b, c, d = index[:-1, :-1].ravel(), index[1:, :-1].ravel(), index[:-1, 1:].ravel(), index[1:, 1:].ravel()
    faces = np.concatenate([np.stack([a, c, b], 1), np.stack([b, c, d], 1)]).astype(np.int32)
    return np.stack([x, np.zeros_like(x), z], axis=-1).reshape(-1, 3).astype(np.float32), faces


def tube(count):
    """A closed tube along x with deep grooves, some `count` vertices: length 1, radius .07."""
    across = max(8, int(np.sqrt(count / 3)) // 2 * 2)
    along = max(8, count // across)
    grid, faces = sheet(along, across + 1)
    turn = 2 * np.pi * np.round(grid[:, 2] * across) / across
    turn[grid[:, 2] == 1] = 0.0
    radius = 0.07 * np.sqrt(np.clip(1 - (2 * grid[:, 0] - 1) ** 8, 0, 1)) * (1 + 0.35 * np.sin(40 * grid[:, 0])) + 1e-4
    index = np.arange(len(grid)).reshape(along, across + 1)
    index[:, across] = index[:, 0]
    vertices = np.stack([grid[:, 0] - 0.5, radius * np.cos(turn), radius * np.sin(turn)], axis=1).astype(np.float32)
    faces = index.ravel()[faces]
    used, faces = np.unique(faces, return_inverse=True)
    return vertices[used], faces.reshape(-1, 3).astype(np.int32)


def mesh(vertices, faces, normals=None):
    normals = face_normals(vertices, faces) if normals is None else normals
    return Mesh(vertices, normals, faces, np.full(vertices.shape, 200, np.uint8))


def hills(vertices):
    """Rolling ground with some thirty hills, (V, 3) float32."""
    x, z = vertices[:, 0], vertices[:, 2]
    height = 0.03 * np.sin(17 * x) * np.sin(15 * z) + 0.01 * np.sin(50 * x + 3 * z)
    return (vertices + np.stack([0 * x, height, 0 * x], axis=1)).astype(np.float32)


def ground(count):
    """Hills of `count` vertices in ten strips, each a chunk."""
    across = round(np.sqrt(count))
    along = max(2, round(count / across / CHUNKS))
    chunks = []
    for strip in range(CHUNKS):
        vertices, faces = sheet(along, across)
        chunks.append(mesh(hills((vertices * [0.1, 1, 1] + [0.1 * strip, 0, 0]).astype(np.float32)), faces))
    return Scene(chunks)


def swollen(chunk, step):
    """A chunk with a bulge that moves along it and leaves its borders where they are."""
    vertices = chunk.vertices.copy()
    low, high = vertices[:, 0].min(), vertices[:, 0].max()
    across = np.clip((vertices[:, 0] - low) * (high - vertices[:, 0]) / (high - low) ** 2 * 4, 0, 1)
    vertices[:, 1] += (0.04 * across * np.exp(-40 * (vertices[:, 2] - 0.3 - 0.02 * step) ** 2)).astype(np.float32)
    return vertices, face_normals(vertices, chunk.faces)


def products(counts, report):
    ways = "float32", "BLAS"
    columns = {"vertices": ",", "K": "d", "copy_ms": ".3f"}
    for way in ways:
        columns |= {f"{way}_ms": ".3f", f"{way}_x": ".1f"}
    table = report.table("product: ms, and times the copy", **columns)
    rng = np.random.default_rng(0)
    for count in counts:
        for coefficients in (9, 25, 64):
            transfer = rng.normal(size=(count, coefficients)).astype(np.float32)
            light = rng.normal(size=(coefficients, 3)).astype(np.float32)
            out = np.zeros((count, 3), np.float32)
            source = np.ones((transfer.nbytes + out.nbytes) // 8, np.float32)  # read and written: as many in all
            target = np.zeros_like(source)
            whole = BlockTransfer(transfer)
            works = [
                lambda _, a=target, b=source: np.copyto(a, b),
                lambda _, p=whole, c=light: p.apply(c),
                lambda _, t=transfer, c=light, o=out: np.maximum(np.matmul(t, c, out=o), 0, out=o),
            ]
            best = np.full(len(works), np.inf)
            for _ in range(TRIES):  # alternating, so a busy moment hits all alike
                for i, work in enumerate(works):
                    best[i] = min(best[i], measured(work, 1)[0])
            row = {"vertices": count, "K": coefficients, "copy_ms": best[0]}
            for way, time_ms in zip(ways, best[1:], strict=True):
                row |= {f"{way}_ms": time_ms, f"{way}_x": time_ms / best[0]}
            table.add(**row)


def latencies(counts, frames, environment, report):
    works = "rotate", "swap", "one_of_ten_chunks"
    columns = {"vertices": ",", "bands": "d", "rays": "d"} | dict.fromkeys(works, "<22")
    table = report.table("latencies, ms: median, 95% (median processor ms)", **columns, rows_new=",.0f")
    for count in counts:
        scene = ground(count)
        for bands, rays in ((3, 32), (8, 128)) if count < 500_000 else ((3, 32),):
            live = DynamicTransfer(scene, [4], bands, rays)
            product, light = BlockTransfer(live.transfer), environment.sh(bands)

            def rotate(step, product=product, bands=bands):
                product.apply(environment.rotated(7.0 * step).sh(bands))

            def swap(step, product=product, bands=bands):
                product.apply(Environment(environment.radiance).sh(bands))

            rows, repeats = [], max(3, frames if count < 500_000 else frames // 4)
            poses = [swollen(scene.chunks[4], step) for step in range(repeats + 1)]

            def deform(step, poses=poses, live=live, product=product, light=light, rows=rows):
                new = live.update(4, *poses[step])
                rows.append(len(new))
                product.write(new, live.transfer[new])
                product.apply(light)

            live.update(4, *poses[-1])
            cells = [shown(measured(work, 3 * repeats), 2) for work in (rotate, swap)]
            cells.append(shown(measured(deform, repeats)))
            row = {"vertices": product.count, "bands": bands, "rays": rays} | dict(zip(works, cells, strict=True))
            table.add(**row, rows_new=float(np.median(rows)))


def pose(kind, rest, phase):
    """Vertices of a tube that twists or bends, (V, 3) float32."""
    x, y, z = rest.T.astype(np.float64)
    amount = np.sin(phase)
    if kind == "twist":
        flat = y * 1.8  # an elliptic section: a round one would not show a twist
        angle = 4.0 * amount * x
        return np.stack(
            [x, flat * np.cos(angle) - z * np.sin(angle), flat * np.sin(angle) + z * np.cos(angle)], 1
        ).astype(np.float32)
    curve = 1e-3 + 2.5 * amount
    reach = 1.0 / curve - y
    return np.stack([reach * np.sin(curve * x), 1.0 / curve - reach * np.cos(curve * x), z], axis=1).astype(np.float32)


def deforming(counts, frames, environment, report):
    columns = {"motion": "<16", "vertices": ",", "moving": ",", "method": "<48", "bands": "d", "rays": "d"}
    columns |= {"ms_a_frame": "<22", "error": ".1f", "error_rest": ".1f"}
    title = "deforming: median, 95% (median processor ms), error in % of the moving mesh, and of the rest"
    table = report.table(title, **columns)
    for kind in DEFORMATIONS:
        for count in counts:
            over = kind == "arm over a table"
            rest, faces = tube(count // 4 if over else count)

            def form(frame, rest=rest, faces=faces, over=over, kind=kind):
                lifted = pose("bend" if over else kind, rest, 0.1 * frame) + np.float32([0.0, 0.25 * over, 0.0])
                return lifted, face_normals(lifted, faces)

            arms = [form(frame) for frame in range(frames + 1)]
            chunks = [mesh(arms[0][0], faces, arms[0][1])]
            if over:
                top, top_faces = sheet(round(np.sqrt(0.75 * count)), round(np.sqrt(0.75 * count)))
                chunks.append(mesh((top * 1.4 - [0.7, 0, 0.7]).astype(np.float32), top_faces))
            scene, references = Scene(chunks), {}
            for name, bands, rays in METHODS:
                light = environment.sh(bands)
                if bands not in references:
                    last = Scene([mesh(arms[-1][0], faces, arms[-1][1]), *chunks[1:]])
                    references[bands] = np.maximum(
                        DynamicTransfer(last, [0], bands, REFERENCE_RAYS).transfer @ light, 0
                    )
                times, transfer = frame_times(name, scene, arms, bands, rays)
                add(table, kind, scene, name, bands, rays, times, np.maximum(transfer @ light, 0), references[bands])
            gash(table, kind, scene, arms, environment, references[3])


def frame_times(name, scene, arms, bands, rays):
    """Times of a frame by a method, and the transfer of the last frame."""
    moving = len(scene.chunks[0].vertices)
    if name == "analytic":
        rest = analytic(np.concatenate([chunk.normals for chunk in scene.chunks]), bands)[moving:]
        times = measured(lambda step: analytic(arms[step + 1][1], bands), len(arms) - 1)
        return times, np.concatenate([analytic(arms[-1][1], bands), rest])
    live = DynamicTransfer(scene, [0], bands, rays)
    live.update(0, *arms[0])
    times = measured(lambda step: live.update(0, *arms[step + 1]), len(arms) - 1)
    return times, live.transfer


def gash(table, kind, scene, arms, environment, reference):
    """The paper's network, for the vertices that move."""
    try:
        from relight.transfer.neuralgash import neural_gash

        neural_gash(*arms[0])
    except Exception as error:
        print(f"neural-gash left out: {error}", file=sys.stderr)
        return
    moving = len(arms[0][0])
    times = measured(lambda step: neural_gash(*arms[step + 1]), len(arms) - 1)
    rest = analytic(scene.normals, 3)[moving:]
    transfer = np.concatenate([neural_gash(*arms[-1]), rest])
    add(table, kind, scene, "neural-gash", 3, 0, times, np.maximum(transfer @ environment.sh(3), 0), reference)


def add(table, kind, scene, name, bands, rays, times, radiance, reference):
    """A row of one method; a mesh that is all there is has no rest."""
    moving = len(scene.chunks[0].vertices)
    parts = {"error": slice(0, moving), "error_rest": slice(moving, None)}
    parts = {key: part for key, part in parts.items() if len(reference[part])}
    errors = {key: 100 * relative_error(radiance[part], reference[part]) for key, part in parts.items()}
    row = {"motion": kind, "vertices": len(reference), "moving": moving, "method": name, "bands": bands, "rays": rays}
    table.add(**row, ms_a_frame=shown(times), **errors)


def arguments(parser):
    parser.add_argument("--vertices", nargs="*", type=int, default=[10_000, 100_000, 1_000_000], metavar="N")
    parser.add_argument("--deform", nargs="*", type=int, default=[1_000, 10_000, 50_000], metavar="N")
    parser.add_argument("--frames", type=int, default=16, metavar="N")
    parser.add_argument("--env", default="noon", metavar="FILE")


def run(options, report):
    environment = Environment.load(options.env)
    if options.vertices:
        products(options.vertices, report)
        latencies(options.vertices, options.frames, environment, report)
    if options.deform:
        deforming(options.deform, options.frames, environment, report)
