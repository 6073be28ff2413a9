"""Environments: from files or by formula, as images, as coefficients, and with their suns split off."""

SKIES = ("new", "keep", "drop")
"""What becomes of the far background of a relit splat: it shows the new light, stays as captured, or goes."""

CAPTURED = "captured"
"""What the light of the capture is called, where it is asked for as a light."""

SUN_TOLERANCE = 0.007
"""What splitting suns off may leave, where nothing is planned: of the estimate of `sun_split.split`, which is for walls
beside every vertex. True errors of 10 bands and 256 rays were 0.2 to 1.1 of it on two objects, and 0.5 to 1.5 on two
tables full of them, under eight lights (scripts/bench light)."""
