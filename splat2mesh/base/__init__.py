"""The base of both commands: errors, console, progress, writing without partial files."""
