"""What other programs' description files, URDF and SDF, say of bodies and of their surroundings."""
