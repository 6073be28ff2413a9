# ---
# jupyter:
#   kernelspec: {display_name: Python 3, language: python, name: python3}
# ---

# %% [markdown]
# # Put a splat under another light
#
# Open this file as a notebook (VS Code does it as it is, Jupyter with jupytext). It makes a small splat to work on and
# needs no data; with a splat of your own everything below stays the same.

# %%
from pathlib import Path

import numpy as np
from IPython.display import Image, display

from relight import Environment, Relighter, estimate_albedo, relight_splat
from relight.light.tonemap import auto_exposure
from relight.output.mesh_files import write_png
from relight.output.preview import Preview
from scenes import bake, build, exposure, splats_from
from splat2mesh import convert
from splat2mesh.render.rasterize import rasterize
from splat2mesh.render.view import View
from splat2mesh.scene.color import bytes_from_unit
from splat2mesh.splats.formats import read_splats, write_splats

FOLDER = Path("relight_a_splat")
FOLDER.mkdir(exist_ok=True)


def show(name, picture):
    """Save a picture, (H, W, 3) uint8, and show it."""
    write_png(FOLDER / name, picture)
    display(Image(FOLDER / name))


# %% [markdown]
# ## A splat with light baked in
#
# A generated table, captured under an overcast sky. `splats_from` makes Gaussians as training would leave them.

# %%
truth = build("tabletop", seed=1, vertices=3_000)
radiance = bake(truth, Environment.load("overcast"))
write_splats(FOLDER / "table.ply", splats_from(truth, radiance * exposure(radiance), 5_000))

# %% [markdown]
# ## In one line
#
# `relight_splat("table.ply", "sunset", angle_deg=45).save("table_sunset.ply")` is all it takes. Step by step it is:
#
# ## A mesh from the splat alone
#
# Virtual views are chosen, the surface is found in each, and all are fused. No photos are needed.

# %%
scene = convert(FOLDER / "table.ply", vertices=2_000, detail="draft")
camera = scene.preview_camera
flip = np.array([1, -1, -1])  # from the scene frame, y up, to the frame of the splat: half a turn about x
eye, target, up = (np.array(camera[key]) * flip for key in ("eye", "target", "up"))
view = View.look_at(eye, target, up, camera["fov_deg"], 320, 240)


def photo(splats):
    """The splats as the camera sees them, over black."""
    return bytes_from_unit(np.clip(rasterize(splats, view).color, 0, 1))


splats = read_splats(FOLDER / "table.ply")
show("captured.png", photo(splats))
print(f"{len(splats):,} Gaussians, a mesh of {len(scene.vertices):,} vertices")

# %% [markdown]
# ## Take the light of the capture out
#
# What a vertex shows is its albedo times the light that reaches it. The estimate tells the two apart by the shape of
# the mesh, and says how much evidence the scene holds.

# %%
relighter = Relighter(scene, tolerance=0.05)
found = estimate_albedo(relighter)
print(f"evidence {found.capture['evidence']:.2f}, separable: {found.capture['separable']}")

# %% [markdown]
# ## New light, as a mesh
#
# Every light is planned: what this scene does not need for an error of 5% is not computed.

# %%
sunset = Environment.load("sunset").rotated(45)
print("\n".join(relighter.plan_for(sunset, found.albedo).table()[:8]))
relit = relighter.shade(sunset, found.albedo)  # (V, 3) linear
show("mesh_sunset.png", Preview(scene, camera, 320, 240).render(relit, sunset, auto_exposure(relit)))

# %% [markdown]
# ## New light, as a splat
#
# Each Gaussian takes the light ratio at its place on the mesh. The file opens in any splat viewer.

# %%
relit_splat = relight_splat(scene, sunset, albedo=found.albedo, tolerance=0.05)
relit_splat.save(FOLDER / "table_sunset.ply", overwrite=True)
show("splat_sunset.png", photo(relit_splat.splats))
