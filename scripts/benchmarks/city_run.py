"""The process that `scripts/bench city` starts: it meshes a city once, or repeatedly while being killed."""

import json
import os
import random
import threading
import time
from pathlib import Path

import numpy as np

from splat2mesh.base.progress import Stages
from splat2mesh.options import ConvertOptions, TilingOptions
from splat2mesh.tiles import survey
from splat2mesh.tiles.city import city_in_steps
from splat2mesh.tiles.store import Store
from splat2mesh.tiles.tasks import TaskSteps, tiling_engine


def main(source, output, workers, settings):
    """Mesh a city; JSON on stdout. workers, settings: JSON; settings are those of a city, `pixels`, the side
    of the views, and `deaths`, in how many runs one of the workers is killed
    besides two in which none is."""
    workers, settings = json.loads(workers), json.loads(settings)
    survey.PIXELS["draft"] = settings.pop("pixels", survey.PIXELS["draft"])
    deaths = settings.pop("deaths", None)
    with tiling_engine(TilingOptions(workers=workers)) as running:
        if deaths is None:
            print(json.dumps(city_in_steps(source, TaskSteps(Store(output), running, Stages()), *_asked(settings))))
            return
        usual, died, number = 0.0, 0, 0
        while died < deaths or number < 1:
            place, start = Path(f"{output}_{number}"), time.perf_counter()
            after = random.Random(number).uniform(0.05, 0.95) * usual if number > 1 else None
            killer = _Killer(running.client, place, after)
            city_in_steps(source, TaskSteps(Store(place), running, Stages()), *_asked(settings))
            usual = min(usual or np.inf, time.perf_counter() - start)
            found = killer.found()
            died += found["killed_after"] is not None
            number += 1
            print(json.dumps({"output": str(place), "number": died, **found}), flush=True)


def _asked(settings):
    """ConvertOptions and TilingOptions of loose settings."""
    tiling = {name: settings[name] for name in ("memory", "tile_splats", "resume") if name in settings}
    wanted = {name: value for name, value in settings.items() if name not in tiling}
    return ConvertOptions(detail="draft", **wanted), TilingOptions(**tiling)


class _Killer:
    """Kills one of a client's workers some seconds from now, or none."""

    def __init__(self, client, place, seconds):
        self.pids, self.place, self.seconds = list(client.run(os.getpid).values()), place, seconds
        self.record = {"killed_after": None, "tiles_done": None}
        self.timer = threading.Timer(seconds or 0.0, self._kill) if seconds is not None else None
        if self.timer:
            self.timer.start()

    def _kill(self):
        done = len(list(self.place.glob("tiles/*/mesh.json")))
        os.kill(random.Random(self.seconds).choice(self.pids), 9)
        self.record = {"killed_after": self.seconds, "tiles_done": done}

    def found(self):
        """When, in seconds, and with how many tiles done; None where the run was over before."""
        if self.timer:
            self.timer.cancel()
            self.timer.join()
        return self.record
