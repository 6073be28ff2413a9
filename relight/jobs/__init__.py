"""A request carried out: its inputs, the scene as it is known, its light, and the results in folders."""
