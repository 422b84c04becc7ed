"""Stages of the implicit step, at which a method does work of its own (`compiled.stage`).

In the order of a step: `before_step`, and `before_groups` where something acts; of each group `before_group`,
then intervals, each `before_travel`, `before_contact` where something may touch, and `after_travel`, with an
impact, `after_impact`, between two;
`before_flight` and `after_flight` of a body that nothing can reach, `on_sleep` of one that rests; at last
`after_groups`. `undo_step` takes back a step that is done again with more room.
"""

from ..compiler import stage


@stage
def before_step(method, x, step, world, work):
    """A step begins, with so many before it, at ``x`` (B, 13)."""


@stage
def undo_step(method, work):
    """Room overflowed, and the step begins anew: what `before_step` saw holds again."""


@stage
def before_groups(method, x, begin, world, work):
    """In a scene with actions, driven bodies are where they begin the step, at time ``begin``."""


@stage
def after_groups(method, x, end, world, work):
    """They are where they end it, at time ``end``."""


@stage
def on_sleep(method, i, work):
    """Body i rests: its pose stays, and its velocities are zero."""


@stage
def before_flight(method, x, i, world, work):
    """Body i will fly freely for a whole step; ``x`` (B, 13) and ``work.R`` are those before."""


@stage
def after_flight(method, x, i, world, work):
    """It flew."""


@stage
def before_group(method, count, world, work):
    """The step of a group begins, of ``count`` members."""


@stage
def before_travel(method, x, count, until, left, threshold, world, work):
    """The group at hand, in a step that has ``left`` seconds, will travel for ``until``.

    Contacts at hand are those of this pose; with ``until < left`` one of them closes then, faster than
    ``threshold`` (`impact_time.time_to_close`).
    """


@stage
def before_return(method, x, count, first, until, left, meets, threshold, world, work):
    """The group at hand travelled for ``until`` without contacts, on a way to an impact before its end.

    It will travel from where it began for ``first`` seconds instead. With ``meets`` that is when a contact
    closes faster than ``threshold`` (`impact_time.impact_before`), without it a time that depends on nothing.
    ``x``, ``work.R`` and the contacts at hand are those of the end.
    """


@stage
def before_contact(method, x, count, world, work):
    """The lasting contacts of the group at hand are known, and not their impulses.

    ``x`` (B, 13), ``work.R`` and the contacts' rows are those of the interval's end as it would be without
    contacts (`FREE`, `FREE_POSITION`, `FREE_QUATERNION`).
    """


@stage
def after_travel(method, x, count, h, world, work):
    """The group at hand travelled for ``h`` seconds under the impulses on record (`LASTING`).

    The contacts' rows are those of the interval's end without contacts (`before_contact`). Velocities and
    poses of its beginning are on record (`START`, `START_POSITION`, `START_QUATERNION`); ``x`` and ``work.R``
    are those of its end.
    """


@stage
def after_impact(method, x, count, threshold, world, work):
    """The contacts at hand acted on the group as the impulses on record (`ELASTIC`); `START` and `NOW` are
    the velocities before and after. A contact that closed faster than ``threshold`` rebounds.
    """
