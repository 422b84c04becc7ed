"""Stages of the implicit step in which a method adds its own work (`compiler.stage`).

In the order of a step: `before_step`, and `before_groups` in a scene with actions. For each group
`before_group`, then intervals, each with `before_travel`, `before_contact` if contacts are possible, and
`after_travel`. Between two intervals is an impact, `after_impact`. A body without reachable partners has
`before_flight` and `after_flight`, a sleeping one `on_sleep`. The last is `after_groups`. `undo_step` cancels
a step that is repeated with more room.
"""

from ..compiler import stage


@stage
def before_step(method, x, step, world, work):
    """Called before a step with number ``step``, at ``x`` (B, 13)."""


@stage
def undo_step(method, work):
    """Called after an overflow, before the step is repeated from the state of `before_step`."""


@stage
def before_groups(method, x, begin, world, work):
    """Called in a scene with actions, with kinematic bodies at the step's beginning, time ``begin``."""


@stage
def after_groups(method, x, end, world, work):
    """Called with kinematic bodies at the step's end, time ``end``."""


@stage
def on_sleep(method, i, work):
    """Called for sleeping body i, whose pose is constant and whose velocities are zero."""


@stage
def before_flight(method, x, i, world, work):
    """Called before body i moves freely for a whole step; ``x`` (B, 13) and ``work.R`` precede it."""


@stage
def after_flight(method, x, i, world, work):
    """Called after the free motion of body i."""


@stage
def before_group(method, count, world, work):
    """Called before the step of a group of ``count`` members."""


@stage
def before_travel(method, x, count, until, left, threshold, world, work):
    """Called before the current group moves for ``until`` of the ``left`` seconds of its step.

    The current contacts belong to this pose. If ``until < left``, one of them closes at ``until``, faster
    than ``threshold`` (`impact_time.time_to_close`).
    """


@stage
def before_return(method, x, count, first, until, left, meets, threshold, world, work):
    """Called after the current group moved for ``until`` without contacts past a possible impact.

    It will move for ``first`` seconds from the same start instead. With ``meets``, a contact closes at that
    time, faster than ``threshold`` (`impact_time.impact_before`). Without it, the time depends on no
    variable. ``x``, ``work.R`` and the current contacts are at the end.
    """


@stage
def before_contact(method, x, count, world, work):
    """Called when the lasting contacts of the current group are known, but not their impulses.

    ``x`` (B, 13), ``work.R`` and the contacts' rows are at the interval's end without contacts (`FREE`,
    `FREE_POSITION`, `FREE_QUATERNION`).
    """


@stage
def after_travel(method, x, count, h, world, work):
    """Called after the current group moved for ``h`` seconds under the recorded impulses (`LASTING`).

    The contacts' rows are at the interval's end without contacts (`before_contact`). Velocities and poses of
    its beginning are recorded (`START`, `START_POSITION`, `START_QUATERNION`). ``x`` and ``work.R`` are at
    its end.
    """


@stage
def after_impact(method, x, count, threshold, world, work):
    """Called after an impact of the current contacts with the recorded impulses (`ELASTIC`).

    `START` and `NOW` are the velocities before and after. Contacts that closed faster than ``threshold``
    rebound.
    """
