"""Training of the Neural-GASh network, of its twin with plain Euclidean input, and their ONNX files."""

import json
import time
from pathlib import Path
from typing import NamedTuple

import numpy as np
import onnx
import torch
from onnx import helper, numpy_helper
from torch import nn

from relight.sh import cga, harmonics
from relight.transfer.neuralgash import unit_points

from .labels import as_rgb, transfer_labels
from .meshes import from_folder, generated, random_rotation

WIDTHS = (1024, 512, 256, 128)
OUTPUTS = 27
INPUTS = {"motor": 32, "euclidean": 6}

DROPOUT = 0.1
"""After the first layer, halved from layer to layer, as it decays in the paper; how much is this project's choice."""

BATCH = 2048
PER_MESH = 256
"""Vertices of a mesh in a round, each round other ones and in another pose: every mesh counts the same."""

RATE = 2e-3
WEIGHT_DECAY = 1e-3
WARM_UP = 0.05
"""Largest learning rate; the part of the time in which it gets there. After that it falls to 0 as a cosine does."""

MESHES, HELD_OUT = 600, 50
QUICK_MESHES, QUICK_HELD_OUT = 20, 10

HELD_OUT_SEED = 2**20
"""Added to the seed: meshes of the same kinds, none of them trained on."""

JUDGE_EVERY, JUDGED = 30.0, 500
"""Seconds between tests on the held-out meshes, and about how many vertices of each; the best network is kept."""

REFERENCES = 8

OPSET, IR_VERSION = 15, 8
"""Opset of the ONNX file: old enough for every runtime of recent years."""


class Example(NamedTuple):
    """A labelled mesh in any frame. vertices: (V, 3) float64. normals: (V, 3). transfer: (V, 9) float32."""

    name: str
    vertices: np.ndarray
    normals: np.ndarray
    transfer: np.ndarray


def train(options):
    """Train as `scripts/train neural-gash` says and write the ONNX file; returns lines to print.

    options: meshes (folder or None), minutes, seed, out (folder), quick, euclidean (the twin instead), say(line).
    """
    kind = "euclidean" if options.euclidean else "motor"
    count, held_out = (QUICK_MESHES, QUICK_HELD_OUT) if options.quick else (MESHES, HELD_OUT)
    log = []

    def report(line):
        log.append(line)
        options.say(line)

    examples = labelled(generated(count, options.seed))
    if options.meshes is not None:
        examples += labelled(from_folder(options.meshes))
    judges = labelled(generated(held_out, options.seed + HELD_OUT_SEED))
    vertices = sum(len(example.vertices) for example in examples)
    report(f"{kind}: {len(examples)} meshes with {vertices:,} vertices, {len(judges)} meshes held out")
    network = fit(kind, examples, judges, 60.0 * options.minutes, options.seed, report)
    out = Path(options.out)
    out.mkdir(parents=True, exist_ok=True)
    file = out / ("neural-gash.onnx" if kind == "motor" else "neural-gash-6d.onnx")
    file.write_bytes(exported(network, kind, log))
    return [f"{file}: {file.stat().st_size:,} bytes"]


def labelled(meshes):
    """A list of Example of meshes, without the vertices that no light reaches: mostly those inside another solid."""
    examples = []
    for mesh in meshes:
        transfer = transfer_labels(mesh)
        lit = transfer[:, 0] > 0.0
        if lit.any():
            examples.append(Example(mesh.name, mesh.vertices[lit].astype(np.float64), mesh.normals[lit], transfer[lit]))
    return examples


def encoded(kind, vertices, normals):
    """The input of a network of this kind for a whole mesh, (V, 32) or (V, 6) float32."""
    points = unit_points(vertices)
    if kind == "motor":
        return cga.vertex_motors(points, normals)
    return np.concatenate([points, normals], axis=1).astype(np.float32)


def network_of(kind):
    """The untrained network: linear, batch-norm, SiLU and dropout four times, then linear to 27 numbers."""
    layers, before = [], INPUTS[kind]
    for depth, width in enumerate(WIDTHS):
        layers += [nn.Linear(before, width), nn.BatchNorm1d(width), nn.SiLU(), nn.Dropout(DROPOUT / 2**depth)]
        before = width
    return nn.Sequential(*layers, nn.Linear(before, OUTPUTS))


def fit(kind, examples, judges, seconds, seed, report):
    """Train a network for some seconds of processor time; returns that of the least error on the held-out `judges`."""
    torch.manual_seed(seed)
    rng = np.random.default_rng(seed)
    network = network_of(kind)
    optimizer = torch.optim.AdamW(network.parameters(), RATE, weight_decay=WEIGHT_DECAY)
    scale = 1.0 / np.mean([np.mean(example.transfer**2) for example in examples])
    short = _short_floats_are_faster()
    best, state, looked, samples = np.inf, None, 0.0, 0
    start = time.process_time()  # whatever else the machine does, the same budget is the same training
    passed = 0.0
    while passed < 1.0:
        for inputs, targets in _round(kind, examples, rng):
            passed = (time.process_time() - start) / seconds
            if passed >= 1.0 and samples:
                break
            rise, fall = passed / WARM_UP, 0.5 * (1.0 + np.cos(np.pi * min(passed, 1.0)))
            optimizer.param_groups[0]["lr"] = RATE * max(min(rise, fall), 1e-3)
            optimizer.zero_grad()
            with torch.autocast("cpu", torch.bfloat16, enabled=short):
                found = network(inputs)
            loss = scale * (found.float() - targets).square().mean()
            loss.backward()
            optimizer.step()
            samples += len(inputs)
        if passed >= 1.0 or time.process_time() - start - looked > JUDGE_EVERY:
            looked = time.process_time() - start
            error = float(np.mean(list(errors(network, kind, judges, JUDGED).values())))
            if error < best:
                best, state = error, {name: value.clone() for name, value in network.state_dict().items()}
            report(f"{looked:.0f} s, {samples:,} samples: loss {loss.item():.4f}, mean held-out error {error:.4f}")
    network.load_state_dict(state)
    report(f"kept: mean held-out error {best:.4f}")
    return network.eval()


def predicted(network, inputs):
    """Transfer (V, 9) float32 that a network predicts, the mean of its three colours."""
    network.eval()
    with torch.no_grad():
        rows = [network(part) for part in torch.from_numpy(inputs).split(BATCH)]
    network.train()
    return torch.cat(rows).numpy().reshape(len(inputs), -1, 3).mean(axis=2)


def errors(network, kind, examples, most=None):
    """Relative L2 error of the transfer of each mesh by its name; of about `most` vertices spread over it."""
    found = {}
    for example in examples:
        some = slice(None, None, max(1, len(example.vertices) // (most or len(example.vertices))))
        inputs = encoded(kind, example.vertices, example.normals)[some]
        found[example.name] = relative_error(predicted(network, inputs), example.transfer[some])
    return found


def relative_error(found, expected):
    """L2 norm of the difference over that of the expected array."""
    return float(np.linalg.norm(found - expected) / np.linalg.norm(expected))


def exported(network, kind, log=()):
    """The bytes of an ONNX file of a trained network: Gemm, Sigmoid and Mul, with the batch-norm in the Gemm.

    Input "motor" (V, 32) or "euclidean" (V, 6), output "coefficients" (V, 27), float32. The file's metadata hold the
    log of the training, and as "reference" what torch made of a few inputs: any runtime can be checked against it.
    """
    nodes, weights, value = [], [], kind
    linear = [layer for layer in network if isinstance(layer, nn.Linear)]
    norms = [layer for layer in network if isinstance(layer, nn.BatchNorm1d)]
    for depth, layer in enumerate(linear):
        weight, bias = layer.weight.detach().double(), layer.bias.detach().double()
        if depth < len(norms):
            norm = norms[depth]
            factor = norm.weight.detach().double() / torch.sqrt(norm.running_var.double() + norm.eps)
            weight = weight * factor[:, None]
            bias = (bias - norm.running_mean.double()) * factor + norm.bias.detach().double()
        weights += [
            numpy_helper.from_array(weight.numpy().T.astype(np.float32).copy(), f"weight{depth}"),
            numpy_helper.from_array(bias.numpy().astype(np.float32), f"bias{depth}"),
        ]
        last = depth == len(linear) - 1
        out = "coefficients" if last else f"linear{depth}"
        nodes.append(helper.make_node("Gemm", [value, f"weight{depth}", f"bias{depth}"], [out]))
        if not last:
            nodes.append(helper.make_node("Sigmoid", [out], [f"sigmoid{depth}"]))
            nodes.append(helper.make_node("Mul", [out, f"sigmoid{depth}"], [f"silu{depth}"]))
        value = f"silu{depth}"
    ends = [
        helper.make_tensor_value_info(name, onnx.TensorProto.FLOAT, ["vertices", width])
        for name, width in ((kind, INPUTS[kind]), ("coefficients", OUTPUTS))
    ]
    graph = helper.make_graph(nodes, "neural-gash", ends[:1], ends[1:], weights)
    model = helper.make_model(
        graph, opset_imports=[helper.make_opsetid("", OPSET)], ir_version=IR_VERSION, producer_name="splat2mesh"
    )
    helper.set_model_props(model, {"log": "\n".join(log), "reference": json.dumps(_reference(network, kind))})
    onnx.checker.check_model(model, full_check=True)
    return model.SerializeToString()


def _reference(network, kind):
    """A few inputs of a network and its outputs, not folded, as lists that keep float32 to the bit."""
    rng = np.random.default_rng(0)
    inputs = encoded(kind, rng.uniform(-1.0, 1.0, (REFERENCES, 3)), _directions(rng, REFERENCES))
    network.eval()
    with torch.no_grad():
        outputs = network(torch.from_numpy(inputs)).numpy()
    return {"input": inputs.tolist(), "output": outputs.tolist()}


def _directions(rng, count):
    vectors = rng.normal(size=(count, 3))
    return vectors / np.linalg.norm(vectors, axis=1, keepdims=True)


def _round(kind, examples, rng):
    """Yield batches of some vertices of every mesh, each mesh turned: inputs and the paper's rows of 27."""
    inputs, targets = [], []
    for example in examples:
        turn = random_rotation(rng)
        chosen = rng.choice(len(example.vertices), PER_MESH, replace=len(example.vertices) < PER_MESH)
        points = unit_points(example.vertices @ turn.T)[chosen]
        normals = example.normals[chosen] @ turn.T
        # Points of a unit frame stay as they are in it: `encoded` would frame the chosen ones again.
        motors = cga.vertex_motors(points, normals) if kind == "motor" else np.concatenate([points, normals], axis=1)
        inputs.append(motors.astype(np.float32))
        targets.append(example.transfer[chosen] @ harmonics.rotation_matrix(turn, 3).T.astype(np.float32))
    order = rng.permutation(PER_MESH * len(examples))
    inputs, targets = np.concatenate(inputs)[order], as_rgb(np.concatenate(targets)[order])
    whole = max(len(order) // BATCH, 1) * BATCH  # the rest would be a batch too small to normalise by
    for start in range(0, min(whole, len(order)), BATCH):
        part = slice(start, start + BATCH)
        yield torch.from_numpy(inputs[part]), torch.from_numpy(targets[part])


def _short_floats_are_faster():
    """Whether this processor multiplies in bfloat16 faster than in float32: with its instructions three times."""
    seconds = []
    for dtype in (torch.float32, torch.bfloat16):
        factor = torch.ones(512, 512, dtype=dtype)
        times = []
        for _ in range(5):
            start = time.process_time()
            factor @ factor
            times.append(time.process_time() - start)
        seconds.append(min(times))
    return seconds[1] < seconds[0]
