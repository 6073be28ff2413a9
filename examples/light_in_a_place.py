# ---
# jupyter:
#   kernelspec: {display_name: Python 3, language: python, name: python3}
# ---

# %% [markdown]
# # A place under new light, and the session in a cell
#
# Open this file as a notebook (VS Code does it as it is, Jupyter with jupytext). It makes a small capture of a garden
# to work on and needs no data; with a capture of your own everything below stays the same.

# %%
from pathlib import Path

from IPython.display import Image, display

from relight import relight_splat, view
from scenes.__main__ import main as generate
from splat2mesh import convert

FOLDER = Path("light_in_a_place")
FOLDER.mkdir(exist_ok=True)

# %% [markdown]
# ## A capture
#
# A generated garden as a training leaves it, far trees, sky and floaters too, with the cameras beside it.

# %%
capture = FOLDER / "capture"
small = ["--splats", "6000", "--vertices", "4000", "--views", "16"]
generate([str(capture), "--kind", "garden", "--env", "cloudy", *small, "-q", "--overwrite"])
splat = capture / "point_cloud" / "iteration_30000" / "point_cloud.ply"

# %% [markdown]
# ## A mesh of the place
#
# What tells that this is a place, and no object, is the splat: the capture stood within it. Its far background is kept
# apart and hides no light.

# %%
scene = convert(splat, cameras=capture / "sparse" / "0", detail="draft", vertices=3_000)
scene.save(FOLDER / "scene", overwrite=True)
print(f"captured from {scene.capture['from']}; up: {scene.settings['up_from']}")
display(Image(FOLDER / "scene" / "preview.png"))

# %% [markdown]
# ## Two lights
#
# The first light takes the light of the capture out and traces the shadows; both are kept in the scene's folder, so
# that the second takes a fraction of the time. A tolerance of 20% is for a first look: places have 3% without it.

# %%
for light in ("sunset", "noon"):
    relit = relight_splat(FOLDER / "scene", light, angle_deg=45, tolerance=0.2)
    report = relit.mesh.save(FOLDER / light, overwrite=True)
    display(Image(FOLDER / light / "preview.png"))
print("files:", *report["files"])

# %% [markdown]
# ## The session
#
# Turn the light with the right mouse button or the slider, swap it, switch effects off. Here it is in the cell;
# `relight light_in_a_place/scene --view` opens it as a window, `--serve` in a browser.

# %%
view(FOLDER / "scene", "sunset", tolerance=0.1, size=(640, 480))
