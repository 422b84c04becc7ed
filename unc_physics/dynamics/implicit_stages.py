"""Stages of the implicit step in which a method adds its own work (`compiler.stage`).

A step begins with `before_step`. Each group then moves in intervals, each with `after_travel`. Between two
intervals is an impact, `after_impact`. A sleeping body has `on_sleep`. `undo_step` cancels a step that is
repeated with more room.
"""

from ..compiler import stage


@stage
def before_step(method, x, step, world, work):
    """Called before a step with number ``step``, at ``x`` (B, 13)."""


@stage
def undo_step(method, work):
    """Called after an overflow, before the step is repeated from the state of `before_step`."""


@stage
def on_sleep(method, i, work):
    """Called for sleeping body i, whose pose is constant and whose velocities are zero."""


@stage
def after_travel(method, world, work):
    """Called after the current group moved under the recorded impulses (`LASTING`).

    The contacts' rows are at the interval's end without contacts. ``work.R`` is at its end.
    """


@stage
def after_impact(method, world, work):
    """Called after an impact of the current contacts with the recorded impulses (`ELASTIC`)."""
