"""Environments: from files or by formula, as images, as coefficients, and with their suns split off."""

SKIES = ("new", "keep", "drop")
"""Treatments of the far background of a relit splat: it shows the new light, stays as captured, or goes."""

CAPTURED = "captured"
"""Name of the light of the capture in a request."""

CAPTURED_SKIES = ("clear", "hazy", "overcast", "shade", "night")
"""Kinds of sky that a capture may have had: with a sharp sun, a veiled one, no sun, all in shade, no daylight."""

ANEW = "auto"
"""Captured light to estimate, whatever was chosen before."""

MOST_RADIANCE = 1e12
"""Brighter pixels are clipped to it, and lamps refused, or sums and exposures would leave float32. The sun has 2e9
cd/m^2."""

HEIGHT = 256
WIDTH = 2 * HEIGHT
"""Texels of the image of a sky that is computed: 0.7 degrees."""

SUN_TOLERANCE = 0.007
"""Accepted error of the split of suns where nothing is planned, by the estimate of `sun_split.split`, which is for
walls beside every vertex. True errors of 10 bands and 256 rays were 0.2 to 1.1 of it on two objects, and 0.5 to 1.5 on
two tables full of them, under eight lights (scripts/bench light)."""
