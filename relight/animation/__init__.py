"""Animated glTF: read, posed at any time, lit frame by frame."""
