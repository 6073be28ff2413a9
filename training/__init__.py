"""Training of the networks that come with `relight`: procedural meshes, labels, networks, ONNX files.

It needs torch and onnx: pip install 'splat2mesh[train]'. It is not in the wheel; `scripts/train` runs it from a
checkout.
"""
