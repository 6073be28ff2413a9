"""Live light: the response of every splat to any light, small enough to ship with it.

bundle.write(folder, live)      live.json and the files it names: docs/live.md describes them
page.write(file, folder)        one HTML file, or a folder where it is too large, that shows them under live light
"""
