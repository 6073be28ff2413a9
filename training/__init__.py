"""Training of the networks that come with `relight`: procedural meshes, labels, networks, ONNX files.

Needs torch and onnx: pip install 'splat2mesh[train]'. Not in the wheel; `scripts/train` runs it from a checkout.
"""
