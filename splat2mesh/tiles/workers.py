"""The setup of a dask.distributed process before it works on a city. Needs distributed."""

import os
from typing import Any

from distributed import WorkerPlugin

from ..base.console import ONE_BLAS_THREAD
from .memory import keep_memory


class Prepared(WorkerPlugin):
    """Prepares each new worker, replacements included, before it gets a task."""

    name = "splat2mesh"

    def setup(self, worker: Any) -> None:
        """One thread of BLAS, as in a command; freed memory stays."""
        os.environ.update(ONE_BLAS_THREAD)  # the nanny of dask has one already; without it, where NumPy has not loaded
        keep_memory()
