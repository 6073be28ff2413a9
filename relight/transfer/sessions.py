"""The networks that come with the package, as onnxruntime sessions."""

from importlib import resources
from typing import TYPE_CHECKING

from splat2mesh.base.errors import InputError
from splat2mesh.base.extras import needed
from splat2mesh.base.threads import cores

if TYPE_CHECKING:
    from onnxruntime import InferenceSession

PROVIDERS: tuple[tuple[str, dict[str, str]], ...] = (
    # TF32 keeps 10 bits of each factor: errors of 1e-3, where every other provider has 1e-6.
    ("CUDAExecutionProvider", {"use_tf32": "0"}),
    ("CoreMLExecutionProvider", {}),
    ("DmlExecutionProvider", {}),
    ("CPUExecutionProvider", {}),
)
"""In order of preference, with their options; onnxruntime says which of them are there. The processor always is."""

FATAL = 4
"""Log level: what else onnxruntime has to say is about hardware that is not there, and would stand on stderr."""


def open_session(
    model_name: str,  # such as "neural-gash"
    threads: int,  # that it may use
    accelerated: bool = True,  # whether it may run elsewhere than on the processor
) -> "InferenceSession":
    """An onnxruntime InferenceSession of a model of this package.

    Its threads wait asleep: by default they spin, and take the cores from whatever else computes.
    Raises InputError without onnxruntime, and for a model that is not there or cannot be read.
    """
    onnxruntime = needed("onnxruntime", f"the network {model_name}")
    model = resources.files("relight") / "models" / f"{model_name}.onnx"
    if not model.is_file():
        raise InputError(f"expected the network {model.name} in relight/models, found none: reinstall the package")
    options = onnxruntime.SessionOptions()
    options.intra_op_num_threads, options.inter_op_num_threads = threads, 1
    options.add_session_config_entry("session.intra_op.allow_spinning", "0")
    options.log_severity_level = FATAL
    there = onnxruntime.get_available_providers() if accelerated else ["CPUExecutionProvider"]
    providers = [provider for provider in PROVIDERS if provider[0] in there]
    options.enable_mem_pattern = "DmlExecutionProvider" not in there  # which refuses sessions that have it
    try:
        return onnxruntime.InferenceSession(model.read_bytes(), options, providers=providers)
    except Exception as error:  # onnxruntime raises several types of its own, which are no public names
        reason = str(error).splitlines()[0]
        raise InputError(f"{model.name} cannot be used: {reason}; reinstall the package") from error


def workers_of(session: "InferenceSession") -> int:
    """The number of threads that may run a session at once: one per core, but an accelerator serves one."""
    return cores() if session.get_providers()[0] == "CPUExecutionProvider" else 1
