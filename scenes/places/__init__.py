"""Generated places: a garden, a courtyard, a street, a lounge, a nook, blocks, and small ones hard on light."""

from .place import PLACES, Place, build_place

__all__ = ["PLACES", "Place", "build_place"]
