"""The effects that a scene and a light need, measured on a sample; only these are computed
(`relight.planning.planner.planned`)."""
