"""Functions on the sphere: harmonics, rotations by rotors, motors of conformal geometric algebra, normals."""
