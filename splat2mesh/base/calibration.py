"""The origin of fitted numbers: the provenance of an estimator's calibration."""

from typing import NamedTuple

NOT_RECORDED = "not recorded"


class Provenance(NamedTuple):
    """The origin of the numbers of a calibration. script: the command that fitted or checks them. fitted_on: scenes.
    held_out: the error on scenes that they were not fitted on. Each is NOT_RECORDED where unknown."""

    script: str
    fitted_on: str
    held_out: str
