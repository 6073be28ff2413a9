"""Environments: from files or by formula, as images, as coefficients, and with their suns split off."""
