"""States to begin with: removal of overlaps, settling of resting bodies."""
