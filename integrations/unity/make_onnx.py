"""Writes relight_splat.onnx, the kernel of live light on splats for Unity's Inference Engine (opset 15, any count).

Inputs: cluster (N,) int32, weights (N, W) float32 as bytes hold them, table (C, 1 + W, 3) float32 of one light,
and dc (N, 3) float32, the constant coefficients as captured. Output: relit (N, 3), the same under the light. Run
again after a change: `python integrations/unity/make_onnx.py`.
"""

import sys
from pathlib import Path

import numpy as np
from onnx import TensorProto, checker, helper, numpy_helper, save

C0 = 0.28209479177387814


def model():
    """The ONNX model."""
    nodes, constants = [], []

    def constant(name, value, kind=np.float32):
        constants.append(numpy_helper.from_array(np.asarray(value, kind), name))
        return name

    def node(operation, inputs, output, **attributes):
        nodes.append(helper.make_node(operation, inputs, [output], **attributes))
        return output

    # k = table[cluster, 0] + sum over w of weight[w] table[cluster, 1 + w]: one product with weights that begin by 1.
    rows = node("Gather", ["table", "cluster"], "rows", axis=0)
    first = node(
        "Slice", ["weights", constant("zero", [0], np.int64), constant("one_", [1], np.int64), "one_"], "column"
    )
    ones = node("Add", [node("Mul", [first, constant("none", 0.0)], "nothing"), constant("one", 1.0)], "ones")
    factors = node("Concat", [ones, "weights"], "factors", axis=1)
    across = node("Unsqueeze", [factors, constant("middle", [1], np.int64)], "across")
    k = node("Squeeze", [node("MatMul", [across, rows], "product"), "middle"], "k")
    color = node("Add", [node("Mul", ["dc", constant("c0", C0)], "scaled"), constant("half", 0.5)], "color")
    dark = node("Max", [color, "none"], "dark")
    lifted = node("Div", [node("Add", [dark, constant("offset", 0.055)], "lift"), constant("slope", 1.055)], "lifted")
    toe = node("Div", [dark, constant("toe_slope", 12.92)], "toe")
    bright = node("Pow", [lifted, constant("power", 2.4)], "bright")
    is_toe = node("LessOrEqual", [color, constant("toe_end", 0.04045)], "is_toe")
    linear = node("Where", [is_toe, toe, bright], "linear")
    start = node("Max", [linear, constant("shoulder", 0.8)], "start")
    room = node("Max", [node("Sub", ["one", start], "left"), constant("least_room", 1e-3)], "room")
    plain = node("Mul", [k, linear], "plain")
    over = node("Max", [node("Sub", [plain, start], "beyond"), "none"], "over")
    fall = node("Exp", [node("Neg", [node("Div", [over, room], "steps")], "minus")], "fall")
    rolled = node("Add", [start, node("Mul", [room, node("Sub", ["one", fall], "risen")], "rise")], "rolled")
    shown = node("Where", [node("Greater", [over, "none"], "is_over"), rolled, plain], "shown")
    safe = node("Max", [linear, constant("darkest", 1e-4)], "safe")
    known = node("Greater", [linear, "darkest"], "known")
    ratio = node("Where", [known, node("Div", [shown, safe], "quotient"), k], "ratio")
    kept = node("Min", [node("Max", [ratio, "darkest"], "above"), constant("most", 1e4)], "kept")
    gain = node("Pow", [kept, constant("root", 1 / 2.4)], "gain")
    moved = node("Mul", [gain, node("Add", [color, "offset"], "raised")], "moved")
    final = node("Sub", [moved, constant("back", 0.555)], "final")
    node("Div", [final, "c0"], "relit")
    tensor = helper.make_tensor_value_info
    inputs = [
        tensor("cluster", TensorProto.INT32, ["N"]),
        tensor("weights", TensorProto.FLOAT, ["N", "W"]),
        tensor("table", TensorProto.FLOAT, ["C", "P", 3]),
        tensor("dc", TensorProto.FLOAT, ["N", 3]),
    ]
    graph = helper.make_graph(nodes, "relight_splat", inputs, [tensor("relit", TensorProto.FLOAT, ["N", 3])], constants)
    made = helper.make_model(
        graph, opset_imports=[helper.make_opsetid("", 15)], producer_name="splat2mesh", ir_version=8
    )
    checker.check_model(made, full_check=True)
    return made


if __name__ == "__main__":
    save(model(), sys.argv[1] if len(sys.argv) > 1 else Path(__file__).with_name("relight_splat.onnx"))
