"""Fitted numbers are frozen and described."""

import importlib
import pkgutil
from dataclasses import FrozenInstanceError, fields, is_dataclass
from pathlib import Path

import pytest

import relight
import splat2mesh


def calibrations():
    """Every class called ...Calibration of both packages."""
    found = {}
    for package in (splat2mesh, relight):
        for module in pkgutil.walk_packages(package.__path__, f"{package.__name__}."):
            path = Path(package.__path__[0]).parent / module.name.replace(".", "/")
            source = path.with_suffix(".py")
            if source.is_file() and "Calibration:" in source.read_text():
                for name, each in vars(importlib.import_module(module.name)).items():
                    if name.endswith("Calibration") and each.__module__ == module.name:
                        found[f"{module.name}.{name}"] = each
    return found


CALIBRATIONS = calibrations()


@pytest.mark.parametrize("name", sorted(CALIBRATIONS))
def test_a_calibration_is_frozen_and_described(name):
    calibration = CALIBRATIONS[name]
    assert is_dataclass(calibration)
    shipped = calibration()
    with pytest.raises(FrozenInstanceError):
        setattr(shipped, fields(shipped)[0].name, 0)
    described = calibration.__doc__
    assert [field.name for field in fields(shipped) if field.name not in described] == []


def test_the_calibrations_of_the_mesh_are_found():
    own = {name.rsplit(".", 1)[1] for name in CALIBRATIONS if name.startswith("splat2mesh.")}
    assert {"FloorCalibration", "StandpointCalibration"} <= own
