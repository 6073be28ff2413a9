"""From views of a splat to a clean triangle mesh."""
