"""Motors of the conformal algebra in readable NumPy, the twin of `relight.sh.cga`, and what they stand for."""

import numpy as np
from scipy.spatial.transform import Rotation

ROTOR, MOMENT, TWIN = [0, 6, 7, 10], [8, 11, 13, 26], [9, 12, 14, 27]
"""Places of 1, e12, e13, e23; of e14, e24, e34, e1234; of e15, e25, e35, e1235."""


def up_to(normals):
    """Rotors (V, 4) that take +y to normals, the short way; straight down by half a turn about x."""
    x, y, z = np.moveaxis(normals / np.linalg.norm(normals, axis=-1, keepdims=True), -1, 0)
    lean = np.hypot(x, z)
    with np.errstate(divide="ignore", invalid="ignore"):
        scale = np.where(y < 0, (1 - y) / lean, 1)  # 1 + y cancels below the horizon; (1 + y) (1 - y) = lean^2
        rotor = np.stack([np.where(y < 0, lean, 1 + y), scale * x, 0 * x, -scale * z], axis=-1)
    rotor = np.where(((y < 0) & (lean == 0))[..., None], [0, 0, 0, -1], rotor)
    return rotor / np.linalg.norm(rotor, axis=-1, keepdims=True)


def motor(rotors, shifts):
    """T R, (V, 32) float64: R - t R einf / 2, where t R is a vector and a trivector."""
    (s, e12, e13, e23), (x, y, z) = rotors.T, shifts.T
    vector = [x * s - y * e12 - z * e13, y * s + x * e12 - z * e23, z * s + x * e13 + y * e23]
    motors = np.zeros((len(rotors), 32))
    motors[:, ROTOR] = rotors
    motors[:, MOMENT] = -0.5 * np.stack([*vector, x * e23 - y * e13 + z * e12], axis=-1)
    motors[:, TWIN] = motors[:, MOMENT]
    return motors


def taken_apart(motors):
    """The rotation and the shift (V, 3) of motors: -2 (moment) ~R is the vector t."""
    motors = np.asarray(motors, float)
    length = np.linalg.norm(motors[:, ROTOR], axis=1)[:, None]
    s, e12, e13, e23 = (motors[:, ROTOR] / length).T
    x, y, z, xyz = (motors[:, MOMENT] / length).T
    vector = [x * s + y * e12 + z * e13 + xyz * e23, y * s - x * e12 + z * e23 - xyz * e13]
    vector += [z * s - x * e13 - y * e23 + xyz * e12]
    return Rotation.from_quat(np.stack([s, -e23, e13, -e12], axis=-1), scalar_first=True), -2 * np.stack(
        vector, axis=-1
    )
