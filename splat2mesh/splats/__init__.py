"""Gaussian splats: as arrays, in files, moved and joined."""
