"""Fitting numbers on generated captures: `scripts/fit`."""
