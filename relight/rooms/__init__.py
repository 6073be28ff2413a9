"""Closed rooms: light comes from lamps and surfaces, and new light only through windows.

room = find(relighter, captured)      its lamps, their strength, the albedo of its surfaces; None if it is no closed
room
radiance = room.relit(...)            the captured colours times the change of light
"""
