"""The size of a splat and its distance from the origin, within the range of 32-bit numbers."""

import warnings

import numpy as np

from ..base.errors import DataWarning, InputError
from ..base.threads import ROWS_AT_ONCE
from .splats import Splats

SMALLEST_SPAN = 5e-5
"""Units: a ball of 7e-5 is meshed as one of 7 is (except for 3% of its faces), one of 7e-6 not at all."""

COARSE, TOO_COARSE = 1.0, 4.0
"""Steps between neighbouring numbers at the splats' places, in their widths: where a step is a seventh of the width,
the mesh is as good as at the origin; where it is 4.5 widths, it is rubble."""


def check_extent(splats: Splats) -> None:
    """Refuse splats too small to be meshed, or so far out that their places are rounded to rubble.

    splats: cleaned; a sample of them is checked. Raises InputError for a span below `SMALLEST_SPAN` and for steps
    between places of more than `TOO_COARSE` widths. Warns with a DataWarning where places are rounded to about the
    splats' own width.
    """
    step = 1 + len(splats) // ROWS_AT_ONCE
    places = splats.means[::step]
    low, high = np.percentile(places, [1, 99], axis=0)
    span = float(np.linalg.norm(high - low))
    if span < SMALLEST_SPAN:
        factor = 10.0 ** -np.round(np.log10(max(span, 1e-30)))
        raise InputError(
            f"the splats span {span:.1g} units, expected at least {SMALLEST_SPAN:g}: "
            f"scale them up in an editor, such as SuperSplat, by {factor:.0e} or so"
        )
    away = float(np.abs(np.median(places, axis=0)).max())
    width = float(np.median(splats.scales[::step].max(axis=1)))
    steps = float(np.spacing(np.float32(away))) / max(width, 1e-30)
    if steps > COARSE:
        found = f"the splats lie {away:.2g} units from the origin, where positions round to {steps:.2g} of their widths"
        advice = "remove the offset before training or exporting the splat"
        if steps > TOO_COARSE:
            raise InputError(f"{found}: {advice}")
        warnings.warn(f"{found}, and their surface is rough: {advice}", DataWarning, stacklevel=3)
