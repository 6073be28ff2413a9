"""Environments: from files or by formula, as images, as coefficients, and with their suns split off."""

SKIES = ("new", "keep", "drop")
"""What becomes of the far background of a relit splat: it shows the new light, stays as captured, or goes."""

CAPTURED = "captured"
"""What the light of the capture is called, where it is asked for as a light."""
