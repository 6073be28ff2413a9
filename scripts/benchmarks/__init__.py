"""Benchmarks of cost and accuracy: one module a subject, run by `scripts/bench SUBJECT`."""
