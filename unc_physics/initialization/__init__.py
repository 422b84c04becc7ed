"""Initial states: removal of overlap, and settling of resting bodies."""
