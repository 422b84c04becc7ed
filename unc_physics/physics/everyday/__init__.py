"""The step over exact shapes: one search, contacts that are solved for, impacts as events.

Begin with `step`, whose function `take_step` shows a step from begin to end, and `columns`, which names the
columns of the arrays.
"""
