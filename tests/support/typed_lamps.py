"""Lamps as people type them."""

from relight.lamps.spec import parse_lamps


def parse_lamp(text):
    """The one lamp of a text."""
    [found] = parse_lamps(text)
    return found
