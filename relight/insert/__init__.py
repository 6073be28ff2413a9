"""Objects inserted into a captured place: lit by it, standing in it, casting shadow and light on it."""
