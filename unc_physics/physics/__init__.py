"""Time steps of scenes: the paper's, and the everyday one over exact shapes."""
