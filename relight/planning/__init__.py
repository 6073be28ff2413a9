"""What a scene and a light call for, measured on a sample: only that is computed (`relight.planning.effects.plan`)."""
