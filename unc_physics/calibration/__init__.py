"""What recorded motions say about a scene: friction, restitution, inertia, and what its model leaves out."""
