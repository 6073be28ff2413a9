"""Writes neural-gash.bin: the network of relight/models/neural-gash.onnx for programs without an ONNX runtime.

Little-endian: "GASH", version 1, the number of layers L, L + 1 sizes (uint32); of each layer scales (out float32),
biases (out float32), and weights (out, in) int16, which times the scale of their row are the weights. Half as many
bytes as the ONNX file. Needs `pip install onnx`: `python integrations/web/make_gash.py FOLDER`.
"""

import sys
from pathlib import Path

import numpy as np
from onnx import load, numpy_helper

NETWORK = Path(__file__).parents[2] / "relight" / "models" / "neural-gash.onnx"
STEPS = 32767  # of an int16 on either side of 0


def packed(network=NETWORK):
    """The bytes of the file."""
    arrays = {each.name: numpy_helper.to_array(each) for each in load(network).graph.initializer}
    layers = [(arrays[f"weight{k}"].T, arrays[f"bias{k}"]) for k in range(len(arrays) // 2)]
    sizes = [layers[0][0].shape[1], *(len(bias) for _, bias in layers)]
    parts = [b"GASH", np.array([1, len(layers), *sizes], "<u4").tobytes()]
    for weight, bias in layers:
        scale = np.abs(weight).max(axis=1, keepdims=True) / np.float32(STEPS)
        parts += [scale.astype("<f4").tobytes(), bias.astype("<f4").tobytes()]
        parts += [np.rint(weight / scale).astype("<i2").tobytes()]
    return b"".join(parts)


if __name__ == "__main__":
    (Path(sys.argv[1] if len(sys.argv) > 1 else ".") / "neural-gash.bin").write_bytes(packed())
