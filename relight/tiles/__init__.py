"""Cities in tiles under a new light: one light for all of them, each in the shadow of its neighbours."""
