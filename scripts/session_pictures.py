"""Draw the session on a scene folder that was relit before: its start, its halves and its sky.

python scripts/session_pictures.py SCENE OUT_FOLDER
"""

import sys
from dataclasses import replace
from pathlib import Path

import numpy as np

from relight.light.environment import Environment
from relight.output.images import write_image
from relight.viewer import view
from splat2mesh.scene.color import linear_from_srgb
from splat2mesh.scene.scene import Scene

SIZE, TURN_DEG, HORIZON_DEG = (960, 720), 40.0, 4.0

STATES = {"start": {"sky": False}, "split": {"split": True}, "sky": {"angle_deg": 215.0}}


def main(folder, out):
    """Write viewer_NAME.jpg of every state."""
    scene = Scene.load(folder)
    kept = next((Path(folder) / "cache").glob("albedo-*.npz"))
    albedos = {"estimated": np.load(kept)["albedo"], "captured": linear_from_srgb(scene.colors_srgb / np.float32(255))}
    light = Environment.load("sunset").rotated(TURN_DEG)
    for name, state in STATES.items():
        window = view(scene, light, albedos=albedos, off_screen=True, tolerance=0.01, state=state, size=SIZE)
        if name == "sky":
            window.orbit = replace(window.orbit, elevation_deg=HORIZON_DEG)
        window.finish()
        write_image(f"{out}/viewer_{name}.jpg", window.picture())
        window.close()


if __name__ == "__main__":
    main(*sys.argv[1:])
