"""Functions that stages run for a method (`decorators.stage`); stamps of kernels depend on them."""

#: Functions by the method's class.
WORK: dict[type, list] = {}
