"""The origin of fitted numbers: the provenance of an estimator's calibration."""

from typing import NamedTuple


class Provenance(NamedTuple):
    """The origin of the numbers of a calibration. script: the command that fitted or checks them. fitted_on: scenes.
    held_out: the error on scenes that they were not fitted on. A calibration of which one is unknown has none."""

    script: str
    fitted_on: str
    held_out: str
