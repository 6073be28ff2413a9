"""What the toolkit costs and how near it comes to the truth: one module a subject, run by `scripts/bench SUBJECT`."""
