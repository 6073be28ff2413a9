"""Taking the captured light out: albedo and the light of the capture day, from captured colours and the mesh.

found = estimate(occluder, captured_linear)
relit = shade(new_light, found.albedo)
"""

from .captured import CaptureEvidence, Estimate
from .division import DARKEST, LIGHTEST, Prior, albedo_of
from .estimate import estimate, with_known_light

__all__ = ["DARKEST", "LIGHTEST", "CaptureEvidence", "Estimate", "Prior", "albedo_of", "estimate", "with_known_light"]
