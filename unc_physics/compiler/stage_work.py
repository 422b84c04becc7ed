"""The functions that stages run for a method (`decorators.stage`); stamps of kernels depend on them."""

#: By the method's class.
WORK: dict[type, list] = {}
