"""Live light: what every splat makes of any light, small enough to travel with it.

bundle.write(folder, live)      live.json and the files it names: docs/live.md says what is in them
page.write(file, folder)        one HTML file, or a folder where it is too large, that shows them under live light
"""
