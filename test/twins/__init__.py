"""Plain NumPy twins of the kernels: short, slow, and written from the conventions rather than from the kernels."""
