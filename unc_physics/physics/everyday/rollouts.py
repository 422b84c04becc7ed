"""Rollouts of the step: batches of states, recorded at stops, with a memory of their contacts."""

import math
from typing import NamedTuple

import numpy as np

from ...compiler import inner, kernel
from ...compiler.arrays import empty, integers, zeros
from ...compiler.threads import in_threads
from ...spatial.layout import STATE as STATE_SIZE
from ...spatial.vectors import dot, minus, three, times
from ..actions import Actions
from .columns import (
    ARM,
    AXIS,
    BODY,
    BODY_A,
    BODY_B,
    CENTRE,
    COLS,
    COUNTS,
    FIRST,
    FRAME,
    GRAVITY,
    GROUPS,
    IBODY,
    IMASS,
    INERTIA,
    LAST,
    OFFSET,
    OWN_IMASS,
    PART,
    QUIET,
    RADIUS,
    REMEMBERED,
    ROW0,
    ROWS,
    SINCE,
    SLEEP_AFTER,
    STATE,
    STEP_NUMBER,
    UNKNOWNS,
    WAY,
)
from .contacts import restore, store
from .drives import next_change
from .motion import pose, write
from .search import FULL, Solids, forget_all, place, search_scratch
from .step import Own, Work, note_contacts, note_squeezes, take_step

FIRST_ROOM = 12  # contacts for each body at first; more are made room for when a step needs them
FIRST_LISTS = 64  # rows of the search's lists at first, likewise; all pairs of pieces up to
_MOST_LISTS = 4096  # so many, which are no memory until they are written


class EverydayWorld(NamedTuple):
    """A scene without its state, of B bodies, E elements of the environment and S = B + E materials.

    Attributes
    ----------
    bodies : (nb, BODY) float64
        Rows of `columns`: the bodies, the ground, and each element that tilts.
    pieces, rows : float64
        As in `shapes.columns`; owners are rows of ``bodies``.
    spots : (n, SPOT) float64
    par : (SETTINGS,) float64
    actions : Actions
    count : int
        B.
    dt : float
        [s].
    start : float
        Time at which step 0 would begin [s].
    stop : (1,) int64
        Kernels stop early when this is nonzero; their states are then invalid (`compiler.time_limit`).
    """

    bodies: np.ndarray
    pieces: np.ndarray
    rows: np.ndarray
    spots: np.ndarray
    par: np.ndarray
    actions: Actions
    count: int
    dt: float
    start: float
    stop: np.ndarray


class Variation(NamedTuple):
    """Parameters of M rollouts; with M = 1 all rollouts share them.

    Attributes
    ----------
    materials : (M, MATERIALS, S + P) float64
        Of S surfaces, then of P pairs with values of their own; rows as in `columns`.
    mass : (M, B) float64
        Factors.
    offset : (M, B, 3) float64
        Centres of mass in the pieces' axes [m].
    gravity : (M, 3) float64
    frames : (M, T, 12) float64
        Frames of the elements that tilt.
    held : (M, B, 2) float64
        Times of attachment and release [s].
    shift : (M, B, 7) float64
        Displacement and rotation of paths.
    """

    materials: np.ndarray
    mass: np.ndarray
    offset: np.ndarray
    gravity: np.ndarray
    frames: np.ndarray
    held: np.ndarray
    shift: np.ndarray


class ContactMemory(NamedTuple):
    """What N rollouts remember of their contacts from step to step.

    Attributes
    ----------
    contact : (N, K, REMEMBERED) float64
        Contacts of the last step, with columns as in `columns`.
    count : (N,) int64
        Number of these contacts.
    quiet : (N, B) float64
        Time for which each body has been at rest [s].
    key : (N,) uint64
        Keys for random errors of impacts.
    squeezed : (N, B, 3) float64
        Most by which each body was squeezed between bodies that do not give way [m], and the numbers of these
        two, as of materials (`step.note_squeezes`).
    """

    contact: np.ndarray
    count: np.ndarray
    quiet: np.ndarray
    key: np.ndarray
    squeezed: np.ndarray

    @property
    def at_rest(self):
        """(N, B) bool: bodies that have been at rest so long that their groups may sleep."""
        return self.quiet > SLEEP_AFTER

    def moved(self):
        """Return the memory after states were changed from outside: all contacts are searched for."""
        contact = self.contact.copy()
        contact[..., SINCE] = np.inf
        return self._replace(contact=contact)

    def awake(self, bodies=slice(None)):
        """Return the memory in which some bodies, by default all, do not rest."""
        quiet = self.quiet.copy()
        quiet[:, bodies] = 0.0
        return self._replace(quiet=quiet)

    def renewed(self, bodies):
        """Return the memory in which some bodies are awake and have no contacts."""
        pairs = self.contact[..., BODY_A : BODY_A + 2]
        kept = np.arange(self.contact.shape[1]) < self.count[:, None]
        kept &= ~np.isin(pairs, bodies).any(axis=2)
        order = np.argsort(~kept, axis=1, kind="stable")
        contact = np.take_along_axis(self.contact, order[..., None], axis=1)
        return self._replace(contact=contact, count=kept.sum(axis=1)).awake(bodies)

    def of_bodies(self, bodies):
        """Return the memory of some bodies alone, without contacts: those are found again."""
        return fresh_memory(len(self.count), len(bodies))._replace(
            quiet=np.ascontiguousarray(self.quiet[:, bodies]), key=self.key
        )

    def with_another_body(self):
        """Return the memory with one more body after the others, likewise."""
        new = fresh_memory(len(self.count), self.quiet.shape[1] + 1)
        new.quiet[:, :-1] = self.quiet
        return new._replace(key=self.key)


def fresh_memory(count: int, bodies: int) -> ContactMemory:
    """Return the memory of new rollouts."""
    return ContactMemory(
        np.zeros((count, 0, REMEMBERED)),
        np.zeros(count, np.int64),
        np.zeros((count, bodies)),
        np.zeros(count, np.uint64),
        np.zeros((count, bodies, 3)),
    )


class _Result(NamedTuple):
    """States, first contacts and memory of N rollouts at T stops."""

    states: np.ndarray  # (T, N, B, 13)
    first_time: np.ndarray  # (T, N, B, B + E) float32
    contact: np.ndarray  # (T, N, K, REMEMBERED)
    count: np.ndarray  # (T, N) int64
    quiet: np.ndarray  # (T, N, B)
    squeezed: np.ndarray  # (T, N, B, 3)


@inner
def _most_pieces(bodies):
    """Return the most pieces that a body has."""
    most = 0
    for i in range(len(bodies)):
        most = max(most, int(bodies[i, LAST]) - int(bodies[i, FIRST]))
    return most


@kernel
def arrays_to_work(world, room, lists, count):
    """Return new arrays for a rollout to work with, with room for contacts and rows of lists."""
    spots = empty(world.spots.shape)
    for k in range(len(spots)):
        for x in range(spots.shape[1]):
            spots[k, x] = world.spots[k, x]
    bodies = len(world.bodies)
    return Work(
        empty((bodies, BODY)),
        zeros((room, REMEMBERED)),
        zeros((room, COLS)),
        integers((GROUPS, bodies + 2)),
        empty((UNKNOWNS + 1, UNKNOWNS + 1)),
        empty((4, STATE_SIZE)),
        Solids(world.pieces, world.rows, spots),
        search_scratch(bodies, max(lists, min(_most_pieces(world.bodies) ** 2, _MOST_LISTS))),
        count,
    )


@kernel
def _larger(before, world, old):
    """Return arrays with more room, with the bodies and the ``before`` contacts of old ones."""
    new = arrays_to_work(world, 2 * len(old.C), 2 * len(old.search.near), old.count)
    for i in range(len(old.Y)):
        for x in range(old.Y.shape[1]):
            new.Y[i, x] = old.Y[i, x]
        place(i, new.Y, new.solids)
    pairs = new.search.pairs
    for k in range(before):
        for x in range(old.C.shape[1]):
            new.C[k, x] = old.C[k, x]
        a, b = int(new.C[k, BODY_A]), int(new.C[k, BODY_B])
        if pairs[a, b, ROWS] == 0:
            pairs[a, b, ROW0] = k
        pairs[a, b, ROWS] += 1
    return new


@inner(noinline=True, error_model="numpy")
def _load(x, rows, contacts, quiet, m, world, variation, own, work):
    """Begin a rollout, or go on with one, from its state and memory; ``m`` is its row in the variation."""
    Y, B = work.Y, world.count
    forget_all(work.search)
    for i in range(len(Y)):
        for c in range(Y.shape[1]):
            Y[i, c] = world.bodies[i, c]
    for i in range(B):
        for c in range(STATE_SIZE):
            Y[i, STATE + c] = x[i, c]
        factor = variation.mass[m, i]
        Y[i, OWN_IMASS] /= factor
        Y[i, IMASS] = Y[i, OWN_IMASS]
        for c in range(6):
            Y[i, INERTIA + c] *= factor
            Y[i, IBODY + c] /= factor
        offset = three(variation.offset[m], i, 0)
        write(Y, i, OFFSET, offset)
        Y[i, RADIUS] += math.sqrt(dot(offset, offset))
        arm, axis = minus(three(Y, i, ARM), offset), three(Y, i, AXIS)
        write(Y, i, ARM, minus(arm, times(dot(arm, axis), axis)))
        Y[i, QUIET], Y[i, WAY] = quiet[i], math.inf  # nobody knows how far it went
        pose(Y, i)
    tilted = variation.frames[m]
    for k in range(len(tilted)):
        i = len(Y) - len(tilted) + k
        for c in range(12):
            Y[i, FRAME + c] = tilted[k, c]
        write(Y, i, CENTRE, three(tilted, k, 0))
    for i in range(len(Y)):
        place(i, Y, work.solids)
    for c in range(3):
        own.par[GRAVITY + c] = variation.gravity[m, c]
    restore(contacts, rows, work.C, Y, work.solids, world.actions.surface, own.materials, work.search)


@inner
def _save(n, x, rows, quiet, world, work):
    """Write a rollout's state and memory."""
    for i in range(world.count):
        for c in range(STATE_SIZE):
            x[i, c] = work.Y[i, STATE + c]
        quiet[i] = work.Y[i, QUIET]
    store(n, work.C, work.Y, rows)


@inner
def _copy(values, out):
    """Copy an array of two axes."""
    for i in range(values.shape[0]):
        for c in range(values.shape[1]):
            out[i, c] = values[i, c]


@kernel
def advance(states, first_time, memory, world, variation, place_in, begin, stops, result, count):
    """Advance N rollouts and record them at stops; return how many, and the most contacts of one.

    It ends before the first rollout that has more contacts than there is room for in the result.
    ``place_in`` is the number of the first rollout in the variation.
    """
    B, most, room = world.count, 0, result.contact.shape[2]
    work = arrays_to_work(
        world, max(FIRST_ROOM * B + 2 * 32, memory.contact.shape[1] + 64), FIRST_LISTS, count
    )
    kept_x, kept_quiet, kept_rows = empty((B, STATE_SIZE)), empty(B), empty((room, REMEMBERED))
    kept_first = np.empty(first_time.shape[1:], np.float32)
    par, squeezed, kept_squeezed = empty(len(world.par)), empty((B, 3)), empty((B, 3))
    for n in range(len(states)):
        m = min(place_in + n, len(variation.mass) - 1)
        for c in range(len(par)):
            par[c] = world.par[c]
        _copy(memory.squeezed[n], squeezed)
        own = Own(
            par,
            variation.materials[m],
            variation.held[m],
            variation.shift[m],
            zeros((B, 7)),
            memory.key[n],
            squeezed,
        )
        contacts = memory.count[n]
        if contacts > len(work.C):
            work = arrays_to_work(world, 2 * contacts, len(work.search.near), count)
        _load(states[n], memory.contact[n], contacts, memory.quiet[n], m, world, variation, own, work)
        _copy(first_time[n], kept_first)
        done = 0
        for t in range(len(stops.steps)):
            first, kept = result.first_time[t, n], 0
            rest = 1 if stops.rest[t] > 0.0 else 0  # a shorter step more, from which nothing goes on
            while done < stops.steps[t] + rest:
                now, part = world.start + (begin + done) * world.dt, 0
                end, times = now + world.dt, kept_first
                if done == stops.steps[t]:
                    most, kept = max(most, contacts), contacts
                    if most > room:
                        return n, most
                    _save(contacts, kept_x, kept_rows, kept_quiet, world, work)
                    _copy(kept_first, first)
                    _copy(squeezed, kept_squeezed)
                    end, times = now + stops.rest[t], first
                while now < end:  # in parts between which bodies are attached or released
                    then = next_change(now, end, world.actions, own.held)
                    par[STEP_NUMBER], par[PART] = begin + done, part
                    found = take_step(contacts, B, now, then, world.actions, own, work)
                    if found == FULL:
                        work = _larger(contacts, world, work)
                        continue
                    contacts = found
                    note_contacts(contacts, B, end, work.C, times)
                    note_squeezes(contacts, work.C, work.Y, squeezed)
                    now, part = then, part + 1
                done += 1
                if world.stop[0] != 0:
                    return len(states), most
            most = max(most, contacts)
            if most > room:
                return n, most
            _save(contacts, result.states[t, n], result.contact[t, n], result.quiet[t, n], world, work)
            _copy(squeezed, result.squeezed[t, n])
            result.count[t, n] = contacts
            if rest > 0:
                done, contacts = done - 1, kept
                _copy(kept_squeezed, squeezed)
                _load(kept_x, kept_rows, contacts, kept_quiet, m, world, variation, own, work)
            else:
                _copy(kept_first, first)
    return len(states), most


def recorded(states, first_time, memory, world, variation, begin, stops):
    """Return states, first contacts and memory of rollouts at each of several stops.

    Parameters
    ----------
    states : (N, B, 13) float64
    first_time : (N, B, B + E) float32
    memory : ContactMemory
    world : EverydayWorld
    variation : Variation
    begin : int
        Number of steps done before.
    stops : Stops
        As in `physics.stops`.

    Returns
    -------
    list of (states, first_time, memory)
        The given arrays do not change.
    """
    stops = stops._replace(steps=np.asarray(stops.steps, np.int64), rest=np.asarray(stops.rest, float))
    found = {}

    def run(some):
        room = FIRST_ROOM * states.shape[1] + 64 // max(len(states), 1)  # one alone would be repeated whole
        room = max(room, memory.contact.shape[1])
        first = some.start
        while True:
            some = slice(first, some.stop)
            result = _empty_result(states[some], first_time[some], len(stops.steps), room)
            done, most = advance(
                states[some],
                first_time[some],
                ContactMemory(*(values[some] for values in memory)),
                world,
                variation,
                first,
                begin,
                stops,
                result,
                np.zeros(COUNTS, np.int64),
            )
            found[first] = _Result(*(values[:, :done] for values in result))
            found[first] = found[first]._replace(contact=found[first].contact[:, :, : max(most, 1)].copy())
            first, room = first + done, max(room, 2 * most)
            if first >= some.stop:
                break

    in_threads(len(states), run, steps=states.shape[1] * (int(stops.steps[-1]) + len(stops.steps)))
    parts = [found[start] for start in sorted(found)]
    rows = max(part.contact.shape[2] for part in parts)
    parts = [part._replace(contact=_with_rows(part.contact, rows)) for part in parts]
    all_of = [np.concatenate(values, axis=1) for values in zip(*parts, strict=True)]
    return [
        (x, first, ContactMemory(contact, count, quiet, memory.key, squeezed))
        for x, first, contact, count, quiet, squeezed in zip(*all_of, strict=True)
    ]


def _empty_result(states, first_time, stops, room):
    count, bodies = states.shape[:2]
    return _Result(
        np.empty((stops, *states.shape)),
        np.empty((stops, *first_time.shape), np.float32),
        np.zeros((stops, count, room, REMEMBERED)),
        np.zeros((stops, count), np.int64),
        np.empty((stops, count, bodies)),
        np.empty((stops, count, bodies, 3)),
    )


def _with_rows(contact, rows):
    """Return remembered contacts (T, N, K, REMEMBERED), padded with zeros to K = rows."""
    if rows == contact.shape[2]:
        return contact
    return np.pad(contact, ((0, 0), (0, 0), (0, rows - contact.shape[2]), (0, 0)))
