"""Time steps: contact and friction laws, impacts, free motion, kinematic bodies."""
