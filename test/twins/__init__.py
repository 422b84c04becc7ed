"""Plain NumPy twins of the kernels: short, slow, and written from the conventions, not from the kernels."""
