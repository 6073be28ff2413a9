"""The lights of a request turned about another axis than the vertical: `--rotate 45:1,0,0`."""

from dataclasses import replace

from splat2mesh.base.errors import InputError

from ..light.daylight import DaylightRequest
from ..light.loading import light_of
from ..request import RelightRequest
from .folders import lights_of


def turned_about(request: RelightRequest, axis: tuple[float, float, float] | None) -> RelightRequest:
    """Return the request with its one angle about an axis (3,) of the scene frame, right-handed.

    About the vertical only the angle can change; about another axis the lights do. None is the vertical. Raises
    InputError for the sky of a date, and for lights that cannot be read.
    """
    angle = request.angles_deg[0]
    if axis is None or angle % 360.0 == 0.0:
        return request
    if axis[0] == axis[2] == 0.0:
        return request if axis[1] > 0.0 else replace(request, angles_deg=(-angle % 360.0,))
    lights = lights_of(request)
    if any(isinstance(each, DaylightRequest) for each in lights):
        raise InputError("--rotate: the sky of a date turns about the vertical alone; leave the axis out")
    return replace(request, env=[light_of(each).turned_about(axis, angle) for each in lights], angles_deg=(0.0,))
