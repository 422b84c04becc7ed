"""The paper's physics: spheres with penalty forces, explicit steps, and the step's derivative."""
