"""Objects put into a captured place: lit by it, standing in it, throwing shadow and light on it."""
