"""Splats turned into the frame of SPZ."""

import numpy as np
from scipy.spatial.transform import Rotation
from splat_samples import basis_oracle, unit_vectors

from splat2mesh.splats.splats import Splats


def turned_y_up(splats):
    """The same scene in a world turned by 180 degrees about x; harmonics are refitted, not sign-flipped."""
    turn = Rotation.from_euler("x", 180, degrees=True)
    quats = (turn * Rotation.from_quat(splats.quats_wxyz[:, [1, 2, 3, 0]])).as_quat()[:, [3, 0, 1, 2]]
    up = unit_vectors(200)
    basis_up, basis_down = (basis_oracle(d, splats.degree) for d in (up, turn.inv().apply(up)))
    refit = np.linalg.pinv(basis_up) @ basis_down
    return Splats(
        turn.apply(splats.means),
        splats.scales,
        quats,
        splats.opacities,
        np.einsum("ij,njc->nic", refit, splats.sh),
    )
