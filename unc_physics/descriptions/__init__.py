"""Bodies and environments from URDF, SDF and MJCF description files."""
