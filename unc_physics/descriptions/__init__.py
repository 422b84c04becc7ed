"""Bodies and environments from URDF and SDF description files."""
