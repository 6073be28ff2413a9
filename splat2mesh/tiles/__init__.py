"""Cities in tiles: captures larger than memory, one after another or on many machines, with the same bytes."""
