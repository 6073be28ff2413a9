"""The network of `relight.transfer.neural`: its layers, its training data, and its export to ONNX.

It sees a vertex and a degree l: invariants of several estimates of the shadow there (`relight.transfer.features`).
It answers with how much of each estimate to take, and with the error it expects. The same weights serve all degrees
and all numbers of rays, so ten bands cost nothing to learn.

The loss is the squared error against 4096 rays, per mesh and number of rays over that of plain averaging, so
none outweighs another; 3, 5 and 10 bands count alike. Products of estimates and errors are all it takes (a mix
of fields has an error quadratic in the weights), so the fields themselves need not be kept.
"""

import time
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np
import torch
from torch import nn

from relight.sh import harmonics
from relight.transfer.features import (
    BAND_FEATURES,
    ESTIMATES,
    LOG_BAND,
    LOG_VERTEX,
    OTHERS,
    VERTEX_FEATURES,
    describe,
    differing,
    estimate,
)
from relight.transfer.neighbors import Neighbors
from relight.transfer.occluder import Occluder
from relight.transfer.raytraced import offsets_by_rank, raytraced, trace

from .meshes import TrainingMesh, from_folder, generated

BANDS = 10
METRIC_BANDS = (3, 5, 10)
RAYS = (4, 8, 16, 32, 64, 128, 256)
LABEL_RAYS = 4096
"""Error of a label: 0.2% with 3 bands. A tenth of what 64 averaged rays leave."""

MESHES, VERTICES = 60, 700
"""Meshes of the training set, and vertices sampled from each."""

HIDDEN = 24
STEPS, BATCH, RATE = 12000, 1024, 4e-3
LEAST_SQUARE = 1e-3
"""Added before the logarithm: estimates this far below the expected noise agree."""

MOST_WEIGHT = 2.0
"""Bound of a weight: outside its training data, the network deviates at most this far from its estimates."""


class Mixer(nn.Module):
    """Two hidden layers; what concerns the whole vertex enters the first one once for all degrees."""

    def __init__(self, hidden=HIDDEN):
        super().__init__()
        self.of_vertex, self.of_band = nn.Linear(VERTEX_FEATURES, hidden), nn.Linear(BAND_FEATURES, hidden, bias=False)
        self.inner, self.outer = nn.Linear(hidden, hidden), nn.Linear(hidden, len(OTHERS) + 1)
        with torch.no_grad():
            self.outer.weight *= 0.1  # begins as plain averaging
            self.outer.bias *= 0.0

    def forward(self, vertex, band):
        """(M, VERTEX_FEATURES), (M, B, BAND_FEATURES) -> weights (M, B, S - 1), squared error over noise (M, B)."""
        vertex, band = logarithms(vertex, LOG_VERTEX, 0.0), logarithms(band, LOG_BAND, LEAST_SQUARE)
        hidden = torch.relu(self.of_vertex(vertex).unsqueeze(1) + self.of_band(band))
        out = self.outer(torch.relu(self.inner(hidden)))
        return MOST_WEIGHT * torch.tanh(out[..., :-1]), torch.exp(10.0 * torch.tanh(0.1 * out[..., -1]))

    def standardise(self, vertex, band):
        """Let the first layer see features of mean 0 and deviation 1: these sets' own."""
        with torch.no_grad():
            for layer, x in ((self.of_vertex, vertex), (self.of_band, band.flatten(0, 1))):
                layer.weight /= x.std(dim=0) + 1e-3
                self.of_vertex.bias -= layer.weight @ x.mean(dim=0)


def logarithms(features, count, least):
    """The first `count` columns as logarithms, the rest as they are. At most 1e12, whatever comes."""
    levels = torch.log(torch.clamp(features[..., :count] + least, 1e-12, 1e12))
    return torch.cat([levels, features[..., count:]], dim=-1)


@dataclass(frozen=True)
class Samples:
    """M vertices of one mesh and one number of rays, where estimates differ.

    vertex, band: what the network sees. matrix (M, B, S-1, S-1), slope (M, B, S-1), base (M, B): the squared error of
    weights w is w matrix w - 2 w slope + base. noise: (M, B), expected of own rays. settled, total: (B,), squared error
    where estimates agree, and squared norm of the labels of all.
    """

    name: str
    rays: int
    vertex: np.ndarray
    band: np.ndarray
    matrix: np.ndarray
    slope: np.ndarray
    base: np.ndarray
    noise: np.ndarray
    settled: np.ndarray
    total: np.ndarray


def train(options):
    """Train and write neural.onnx to `options.out`: lines that say how well, on meshes kept back."""
    torch.manual_seed(options.seed)
    say, out, start = options.say, Path(options.out), time.process_time()
    count, vertices, rays = (8, 200, RAYS[:4]) if options.quick else (MESHES, VERTICES, RAYS)
    meshes = list(prepared(generated(count, options.seed), options.seed))
    if options.meshes:
        meshes += list(from_folder(options.meshes))
    parts = []
    for number, mesh in enumerate(meshes):
        parts += samples(mesh, rays, vertices, options.seed)
        say(f"{number + 1}/{len(meshes)} {mesh.name}: {len(mesh.vertices)} vertices")
    held = {mesh.name for mesh in meshes[::8]}
    learn = [part for part in parts if part.name not in held]
    budget = 60.0 * options.minutes - (time.process_time() - start)
    model = fit(learn, options.seed, budget, 200 if options.quick else STEPS, say)
    out.mkdir(parents=True, exist_ok=True)
    export(model, out / "neural.onnx")
    return [*report(model, [part for part in parts if part.name in held]), f"wrote {out / 'neural.onnx'}"]


def prepared(meshes, seed):
    """Every third mesh four times denser, every third rough: scans and reconstructions are neither smooth nor even."""
    import open3d as o3d

    for number, mesh in enumerate(meshes):
        rng = np.random.default_rng([seed, number])
        if number % 3 == 0:
            yield mesh
            continue
        scale = np.ptp(mesh.vertices, axis=0).max()
        points = (mesh.vertices - mesh.vertices.mean(axis=0, dtype=np.float64)) / scale
        dense = o3d.geometry.TriangleMesh(
            o3d.utility.Vector3dVector(points), o3d.utility.Vector3iVector(mesh.faces.astype(np.int32))
        )
        if number % 3 == 1:
            dense = dense.subdivide_loop(1)
        else:
            dense.compute_vertex_normals()
            points, faces = np.asarray(dense.vertices), np.asarray(dense.triangles)
            edge = np.median(np.linalg.norm(points[faces[:, 0]] - points[faces[:, 1]], axis=1))
            height = rng.normal(0.0, rng.uniform(0.03, 0.2) * edge, (len(points), 1))
            dense.vertices = o3d.utility.Vector3dVector(points + height * np.asarray(dense.vertex_normals))
        dense.compute_vertex_normals()
        arrays = (np.asarray(a, np.float32) for a in (dense.vertices, dense.vertex_normals))
        yield TrainingMesh(mesh.name, *arrays, np.asarray(dense.triangles, np.int32))


def samples(mesh, rays, vertices, seed=0):
    """Samples of a mesh for every number of rays: a list."""
    occluder = Occluder(mesh.vertices, mesh.normals, mesh.faces)
    neighbors = Neighbors(occluder.origins, occluder.normals, occluder.faces)
    origins, normals = occluder.origins[neighbors.vertices], occluder.normals[neighbors.vertices]
    rng = np.random.default_rng(seed)
    drawn = np.sort(rng.choice(len(origins), min(vertices, len(origins)), replace=False))
    label = raytraced(occluder, neighbors.vertices[drawn], BANDS, LABEL_RAYS, seed=2**32 + 1).astype(np.float64)
    basis = harmonics.evaluate(normals, BANDS)
    lobe = (harmonics.lambert_coefficients(BANDS) / np.pi)[harmonics.degrees_and_orders(BANDS)[0]]
    shadow = label - basis[drawn] * lobe
    found = []
    for number in rays:
        model, rest = np.zeros((len(origins), 4), np.float32), np.zeros((len(origins), BANDS**2), np.float32)
        turn = seed + number
        offsets = partial(offsets_by_rank, seed=turn)
        for part, traced in trace(occluder, origins, normals, BANDS, number, offsets):
            model[part], rest[part] = traced
        estimates = estimate(neighbors, normals, model, rest, number)
        differ = np.isin(drawn, differing(estimates, 0, len(origins)))
        chosen = drawn[differ]
        vertex, band = describe(estimates, 0, len(origins), basis, chosen)
        fields = estimates.shadows[:, drawn].astype(np.float64)
        change, miss = fields[1:] - fields[0], shadow - fields[0]
        base = by_degree(miss * miss)
        slope = np.stack([by_degree(c * miss) for c in change], axis=-1)
        matrix = np.stack([np.stack([by_degree(a * b) for a in change], axis=-1) for b in change], axis=-1)
        noise = estimates.noise[chosen, None] * (2 * np.arange(BANDS) + 1)
        arrays = vertex, band, matrix[differ], slope[differ], base[differ], noise
        settled, total = base[~differ].sum(axis=0), by_degree(label * label).sum(axis=0)
        found.append(Samples(mesh.name, number, *(a.astype(np.float32) for a in arrays), settled, total))
    return found


def by_degree(products):
    """Sums over the orders of each degree: (..., K) -> (..., B)."""
    return np.add.reduceat(products, np.arange(BANDS) ** 2, axis=-1)


def squared_error(weights, matrix, slope, base):
    """Squared error of the mix, (M, B), never below 0."""
    quadratic = (weights.unsqueeze(-2) @ matrix @ weights.unsqueeze(-1)).squeeze(-1).squeeze(-1)
    return torch.clamp(quadratic - 2.0 * (weights * slope).sum(dim=-1) + base, min=0.0)


def fit(parts, seed, budget, steps=STEPS, say=lambda line: None):
    """Train a Mixer for a number of steps, or of processor seconds if they end first."""
    parts = [part for part in parts if len(part.vertex)]
    importance = []
    for part in parts:
        scale = np.zeros(BANDS)
        for bands in METRIC_BANDS:
            scale[:bands] += 1.0 / max(part.base[:, :bands].sum() + part.settled[:bands].sum(), 1e-9)
        importance.append(np.tile(scale, (len(part.vertex), 1)).astype(np.float32))
    names = "vertex", "band", "matrix", "slope", "base", "noise"
    data = [torch.from_numpy(np.concatenate([getattr(part, name) for part in parts])) for name in names]
    importance = torch.from_numpy(np.concatenate(importance))
    importance = importance * (len(importance) / importance.sum())
    model, generator = Mixer(), torch.Generator().manual_seed(seed)
    model.standardise(logarithms(data[0], LOG_VERTEX, 0.0), logarithms(data[1], LOG_BAND, LEAST_SQUARE))
    optimiser = torch.optim.Adam(model.parameters(), RATE)
    start, progress, step = time.process_time(), 0.0, 0
    unit = (data[4] * importance).mean()
    while progress < 1.0:
        rows = torch.randint(len(importance), (BATCH,), generator=generator)
        vertex, band, matrix, slope, base, noise = (values[rows] for values in data)
        weights, ratio = model(vertex, band)
        square = squared_error(weights, matrix, slope, base)
        expected = ratio * noise
        missed = (square.detach() + 1e-3 * noise) / expected
        loss = (square * importance[rows]).mean() / unit + 0.01 * (torch.log(ratio) + missed).mean()
        for group in optimiser.param_groups:
            group["lr"] = RATE * min(1.0, (step + 1) / 100) * 0.5 * (1.0 + np.cos(np.pi * progress))
        optimiser.zero_grad()
        loss.backward()
        nn.utils.clip_grad_norm_(model.parameters(), 1.0)
        optimiser.step()
        step += 1
        progress = max(step / steps, (time.process_time() - start) / max(budget, 10.0))
        if step % 500 == 0:
            say(f"step {step}: {float(loss.detach()):.4f}")
    return model


def report(model, parts):
    """Lines: error by rays and bands over that of the center, and the error expected over the one made."""
    lines = []
    for rays in sorted({part.rays for part in parts}):
        ratio, calibration = {bands: [] for bands in METRIC_BANDS}, []
        for part in (part for part in parts if part.rays == rays and len(part.vertex)):
            arrays = (torch.from_numpy(getattr(part, name)) for name in ("vertex", "band", "matrix", "slope", "base"))
            with torch.no_grad():
                vertex, band, *form = arrays
                weights, expected = model(vertex, band)
                square = squared_error(weights, *form).numpy()
            for bands in METRIC_BANDS:
                after = square[:, :bands].sum() + part.settled[:bands].sum()
                ratio[bands].append(after / (part.base[:, :bands].sum() + part.settled[:bands].sum() + 1e-12))
            calibration.append((expected.numpy() * part.noise).sum() / max(square.sum(), 1e-12))
        errors = " ".join(f"{b} bands {np.exp(np.mean(np.log(ratio[b])) / 2):.3f}" for b in METRIC_BANDS)
        expected = np.exp(np.mean(np.log(calibration)) / 2)
        lines.append(f"{rays} rays: error over two steps of averaging: {errors}; expected over made: {expected:.2f}")
    return lines


def export(model, path):
    """Write the network as ONNX, opset 15, plain operators, any number of vertices and bands."""
    import onnx
    from onnx import TensorProto, helper, numpy_helper

    def array(tensor):
        return np.ascontiguousarray(tensor.detach().numpy(), np.float32)

    constants = {
        "vertex_weight": array(model.of_vertex.weight.T),
        "vertex_bias": array(model.of_vertex.bias),
        "band_weight": array(model.of_band.weight.T),
        "inner_weight": array(model.inner.weight.T),
        "inner_bias": array(model.inner.bias),
        "outer_weight": array(model.outer.weight.T),
        "outer_bias": array(model.outer.bias),
        "low": np.float32(1e-12),
        "high": np.float32(1e12),
        "least": np.float32(LEAST_SQUARE),
        "zero": np.array([0]),
        "last": np.array([-1]),
        "one": np.array([1]),
        "end": np.array([2**31]),
        "vertex_cut": np.array([LOG_VERTEX]),
        "band_cut": np.array([LOG_BAND]),
        "weight_cut": np.array([len(OTHERS)]),
        "most": np.float32(MOST_WEIGHT),
        "tenth": np.float32(0.1),
        "ten": np.float32(10.0),
    }
    nodes = []

    def add(operator, inputs, output, **attributes):
        nodes.append(helper.make_node(operator, inputs, [output], **attributes))

    for name, shift in (("vertex", None), ("band", "least")):
        add("Slice", [name, "zero", f"{name}_cut", "last"], f"{name}_levels")
        if shift:
            add("Add", [f"{name}_levels", shift], f"{name}_shifted")
        add("Clip", [f"{name}_shifted" if shift else f"{name}_levels", "low", "high"], f"{name}_clipped")
        add("Log", [f"{name}_clipped"], f"{name}_logs")
        add("Slice", [name, f"{name}_cut", "end", "last"], f"{name}_others")
        add("Concat", [f"{name}_logs", f"{name}_others"], f"{name}_seen", axis=-1)
    add("Gemm", ["vertex_seen", "vertex_weight", "vertex_bias"], "vertex_hidden")
    add("Unsqueeze", ["vertex_hidden", "one"], "vertex_all")
    add("MatMul", ["band_seen", "band_weight"], "band_hidden")
    add("Add", ["vertex_all", "band_hidden"], "first")
    add("Relu", ["first"], "first_out")
    add("MatMul", ["first_out", "inner_weight"], "second_product")
    add("Add", ["second_product", "inner_bias"], "second")
    add("Relu", ["second"], "second_out")
    add("MatMul", ["second_out", "outer_weight"], "outer_product")
    add("Add", ["outer_product", "outer_bias"], "out")
    add("Slice", ["out", "zero", "weight_cut", "last"], "raw_weights")
    add("Tanh", ["raw_weights"], "bounded")
    add("Mul", ["bounded", "most"], "weights")
    add("Slice", ["out", "weight_cut", "end", "last"], "raw_level")
    add("Squeeze", ["raw_level", "last"], "level")
    add("Mul", ["level", "tenth"], "level_part")
    add("Tanh", ["level_part"], "level_bounded")
    add("Mul", ["level_bounded", "ten"], "log_square")
    add("Exp", ["log_square"], "square")
    float32 = TensorProto.FLOAT
    graph = helper.make_graph(
        nodes,
        "neural",
        [
            helper.make_tensor_value_info("vertex", float32, ["vertices", VERTEX_FEATURES]),
            helper.make_tensor_value_info("band", float32, ["vertices", "bands", BAND_FEATURES]),
        ],
        [
            helper.make_tensor_value_info("weights", float32, ["vertices", "bands", len(OTHERS)]),
            helper.make_tensor_value_info("square", float32, ["vertices", "bands"]),
        ],
        [numpy_helper.from_array(np.asarray(value), name) for name, value in constants.items()],
    )
    network = helper.make_model(graph, opset_imports=[helper.make_opsetid("", 15)], ir_version=8)
    helper.set_model_props(network, {"estimates": ", ".join(ESTIMATES)})
    onnx.checker.check_model(network)
    onnx.save(network, path)
