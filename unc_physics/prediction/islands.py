"""Groups of bodies that cannot touch each other, each predicted by itself.

Time is divided into slices. At the beginning of a slice the bodies are divided into islands: bodies of
different islands stay apart for the whole slice. For that, each body has a box that it stays in during the
slice. The box is `SIGMAS` standard deviations wide, or as wide as the propagator's own samples lie. A body
that nothing can reach flies freely. The speed of other bodies is bounded by the energy of their island.

Where boxes of different islands overlap, the slice is halved. Where they overlap in the shortest slice, the
islands become one. They also become one if a slice ends with more energy than its bounds allow; the slice is
then done again. Islands never part.

Without slices, bounds would have to hold through seconds of collisions, and everything would be one island.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from ..collision.contact_search import NEAR
from ..collision.shapes import bounds
from ..propagators.base import ClosedFormFlight, JointlySampledIslands, Samples
from ..propagators.free_flight import Flight, course_of
from ..propagators.joining import JointIsland, Part
from ..scene.belief import Belief
from ..scene.marks import Mark
from ..scene.scene import Scene
from ..spatial.layout import ANGULAR_VELOCITY, ERR_POSITION, ERROR, POSITION, VELOCITY

#: Width of boxes, and assumed range of uncertain parameters, in standard deviations.
SIGMAS = 5.0
_NEAR_AT_START = (
    0.03  # distance below which bodies share an island at time 0, when overlap is projected away [m]
)
_SHORTEST = 8  # steps in the shortest slice
_LONGEST = 65536  # steps in the longest slice
_ROUND_OFF = 1e-9  # relative growth of energy that counts as round-off


class Island(NamedTuple):
    """Bodies that are predicted together."""

    bodies: np.ndarray  # (b,) int64: ascending indices; the fixed ones are those within reach
    scene: Scene  # of these bodies
    carry: Any  # the propagator's, at the beginning of the slice
    energy: float  # the most kinetic energy seen at the beginning of a slice [J]
    alone: bool  # whether this is one body, and nothing is within its reach in this slice


class IslandsCarry(NamedTuple):
    """State between steps: islands, their carries at ``step``, and the slice from ``begin`` to ``end``.

    The carry of an island that is alone stays at the beginning of the slice.
    """

    islands: tuple[Island, ...]
    carries: tuple
    begin: int
    end: int
    step: int


class Bounds(NamedTuple):
    """Lowest and highest positions and velocities of bodies, each (B, 3); of width 0 for fixed bodies."""

    low: np.ndarray
    high: np.ndarray
    slowest: np.ndarray
    fastest: np.ndarray
    spin: np.ndarray


class IslandRunner:
    """Propagation of a scene's islands, each separately.

    Each of the scene's uncertain parameters belongs to one moving body (`Scene.shared_parameters` is false).
    Slices end at those of the ascending ``marks`` that are whole steps. ``rollouts`` limits the rollouts to a
    range, from the first index to the one after the last (`propagators.base.Rollouts`).
    """

    def __init__(
        self, propagator: Any, scene: Scene, marks: Sequence[Mark], rollouts: tuple[int, int] | None = None
    ):
        self._propagator, self._scene, self._rollouts = propagator, scene, rollouts
        # a belief between two steps is computed from a copy, so that requesting it changes no slice
        self._ends = [mark.steps for mark in marks if mark.rest == 0.0] + [marks[-1].count]
        bodies, world = scene.bodies, scene.world
        mass = np.array([body.mass for body in bodies])
        factor = np.exp(SIGMAS * np.array([body.mass_std for body in bodies]) / mass)
        self._lightest, self._heaviest = mass / factor, mass * factor
        principal = np.array([np.linalg.eigvalsh(body.unit_inertia) for body in bodies])
        self._softest, self._stiffest = principal[:, 0], principal[:, -1]  # [m^2]
        # a shifted centre of mass circles about the model's
        self._radius = world.bodies.radius + 2.0 * SIGMAS * np.array(
            [np.linalg.norm(b.center_of_mass_std) for b in bodies]
        )
        self._moving = world.bodies.moving
        self._gravity = float(np.linalg.norm(scene.gravity))
        self._can_fly = isinstance(propagator, ClosedFormFlight) and not scene.gyroscopic
        self._samples_jointly = isinstance(propagator, JointlySampledIslands)
        self._parts = {}
        self._joined_last: Any = None, None  # a carry and its joint carry

    def init(self, belief: Belief) -> IslandsCarry:
        """Return the islands at time 0; bodies that touch or have correlated beliefs share an island."""
        scene, moving = self._scene, self._scene.moving
        self._mean = belief.mean
        whole = None
        if self._samples_jointly:
            if self._rollouts is None:
                whole = self._propagator.init(scene, belief)
            else:
                whole = self._propagator.init_rollouts(scene, belief, *self._rollouts)
            near = _in_contact(whole.contact_history.solver)
        else:
            near = self._near(belief)
        both = near[self._moving[near].all(axis=1)]
        labels = merged(np.arange(len(scene.bodies)), np.concatenate([_correlated(belief), both]))
        groups = [np.flatnonzero((labels == label) & self._moving) for label in np.unique(labels[moving])]
        groups = [np.union1d(group, near[np.isin(near, group).any(axis=1)]) for group in groups]
        if whole is not None:
            carries = [self._propagator.part(whole, group, self._parameters(group)) for group in groups]
        else:
            carries = [
                self._propagator.init(self._part(group), _restricted(belief, group)) for group in groups
            ]
        islands = tuple(
            Island(group, self._part(group), carry, 0.0, False)
            for group, carry in zip(groups, carries, strict=True)
        )
        return IslandsCarry(islands, tuple(carries), 0, 0, 0)

    def _near(self, belief):
        """Return pairs (n, 2) of bodies whose beliefs may overlap at time 0, if overlap matters."""
        scene = self._scene
        if scene.integrator == "explicit":
            return np.empty((0, 2), np.int64)
        half = np.repeat(self._radius[:, None] + 0.5 * _NEAR_AT_START, 3, axis=1)
        half[scene.moving] += SIGMAS * np.sqrt(
            np.maximum(np.diagonal(belief.blocks, axis1=1, axis2=2)[:, ERR_POSITION], 0.0)
        )
        pairs = _overlapping(belief.mean[:, POSITION] - half, belief.mean[:, POSITION] + half)
        return pairs[self._moving[pairs].any(axis=1)]

    def advance(self, carry: IslandsCarry, steps: int) -> IslandsCarry:
        """Return the carry after some steps; the division of steps into calls does not matter."""
        target = carry.step + steps
        while carry.step < target:
            if carry.step == carry.end:
                carry = self._plan(carry)
            count = min(target, carry.end) - carry.step
            carries = tuple(
                now if island.alone else self._propagator.advance(now, island.scene, count)
                for island, now in zip(carry.islands, carry.carries, strict=True)
            )
            carry = carry._replace(carries=carries, step=carry.step + count)
            if carry.step == carry.end:
                carry = self._close(carry)
        return carry

    def advance_through(self, carry: IslandsCarry, marks: Sequence[Mark]) -> list[IslandsCarry]:
        """Return the carry at each of several marks, ascending."""
        found = []
        for mark in marks:
            carry = self.advance(carry, mark.steps - carry.step)
            found.append(self._finished(carry, mark))
        return found

    def _finished(self, carry, mark):
        """Return the carry at a mark from the carry after its whole steps, which does not change."""
        if mark.rest == 0.0:
            return carry
        while carry.begin < carry.step:  # end the slice of the copy here, or begin it again
            carry = self._close(carry._replace(end=carry.step))
            carry = self.advance(carry, mark.steps - carry.step)
        islands = self._plan(carry).islands
        part = mark.rest / self._scene.dt
        carries = tuple(
            self._flown(island, part)
            if island.alone
            else self._propagator.advance_through(island.carry, island.scene, [mark])[0]
            for island in islands
        )
        islands = tuple(
            island._replace(carry=now, alone=False) for island, now in zip(islands, carries, strict=True)
        )
        return IslandsCarry(islands, carries, carry.step, carry.step, carry.step)

    def belief(self, carry: IslandsCarry) -> Belief:
        """Return the belief about all bodies: blocks, or the joint covariance with zeros between islands.

        A propagator that samples all bodies jointly computes it from all its samples, as without islands.
        """
        if self._samples_jointly:
            return self._propagator.belief(self.whole(carry), self._scene)
        moving, mean = self._scene.moving, self._mean.copy()
        islands, carries = carry.islands, self._present(carry)
        beliefs = [
            self._propagator.belief(now, island.scene) for island, now in zip(islands, carries, strict=True)
        ]
        for island, own in zip(islands, beliefs, strict=True):
            some = self._moving[island.bodies]
            mean[island.bodies[some]] = own.mean[some]
        places = [np.searchsorted(moving, island.bodies[self._moving[island.bodies]]) for island in islands]
        if all(own.independent or len(own.moving) == 1 for own in beliefs):
            P = np.zeros((len(moving), ERROR, ERROR))
            for place, own in zip(places, beliefs, strict=True):
                P[place] = own.blocks
        else:
            P = np.zeros((len(moving), ERROR, len(moving), ERROR))
            for place, own in zip(places, beliefs, strict=True):
                count = len(place)
                P[np.ix_(place, np.arange(ERROR), place, np.arange(ERROR))] = own.joint.reshape(
                    count, ERROR, count, ERROR
                )
            P = P.reshape(ERROR * len(moving), ERROR * len(moving))
        return Belief.trusted(mean, P, moving)

    def whole(self, carry: IslandsCarry) -> Any:
        """Return the propagator's carry for all bodies of the scene."""
        if self._joined_last[0] is not carry:
            islands = [
                island._replace(carry=now)
                for island, now in zip(carry.islands, self._present(carry), strict=True)
            ]
            self._joined_last = carry, self._joined(islands, np.arange(len(self._scene.bodies)))
        return self._joined_last[1]

    def _present(self, carry):
        """Return each island's carry at the present step."""
        count = carry.step - carry.begin
        return tuple(
            self._flown(island, count) if island.alone and count > 0 else now
            for island, now in zip(carry.islands, carry.carries, strict=True)
        )

    def _flown(self, island, steps):
        world = island.scene.world
        flight = Flight(world.gravity, course_of(world, steps), steps)
        return self._propagator.propagate_flight(island.carry, flight)

    def _part(self, bodies):
        """Return the cached scene of some bodies, which shares the sphere trees."""
        key = tuple(bodies.tolist())
        if key not in self._parts:
            self._parts[key] = self._scene.of_bodies(key)
        return self._parts[key]

    def _parameters(self, bodies):
        """Return the indices of the uncertain parameters that belong to some bodies."""
        known = set(bodies.tolist())
        return [c for c, parameter in enumerate(self._scene.uncertain) if parameter.body in known]

    def _joined(self, islands, bodies):
        """Return one carry of several islands for ``bodies``: those of the islands, and fixed ones."""
        scene = self._part(bodies)
        parts = [
            Part(
                np.searchsorted(bodies, island.bodies),
                np.searchsorted(
                    scene.moving, np.searchsorted(bodies, island.bodies[self._moving[island.bodies]])
                ),
                np.searchsorted(self._parameters(bodies), self._parameters(island.bodies)),
            )
            for island in islands
        ]
        joint = JointIsland(self._mean[bodies], len(scene.moving), scene.world, len(scene.uncertain))
        return self._propagator.join([island.carry for island in islands], parts, joint)

    def _bounds(self, islands, present):
        """Return positions and motions of the bodies of some islands, from their present carries."""
        low, high = self._mean[:, POSITION].copy(), self._mean[:, POSITION].copy()
        slowest, fastest, spin = np.zeros_like(low), np.zeros_like(low), np.zeros_like(low)
        for island, now in zip(islands, present, strict=True):
            some = self._moving[island.bodies]
            bodies = island.bodies[some]
            if isinstance(self._propagator, Samples):
                states = self._propagator.rollout_states(now, island.scene)[:, some]
                least, most = states.min(axis=0), states.max(axis=0)
                low[bodies], high[bodies] = least[:, POSITION], most[:, POSITION]
                slowest[bodies], fastest[bodies] = least[:, VELOCITY], most[:, VELOCITY]
                spin[bodies] = np.maximum(-least[:, ANGULAR_VELOCITY], most[:, ANGULAR_VELOCITY])
            else:
                own = self._propagator.belief(now, island.scene)
                x = own.mean[some]
                spread = SIGMAS * np.sqrt(np.maximum(np.diagonal(own.blocks, axis1=1, axis2=2), 0.0))
                low[bodies], high[bodies] = x[:, POSITION] - spread[:, 0:3], x[:, POSITION] + spread[:, 0:3]
                slowest[bodies], fastest[bodies] = (
                    x[:, VELOCITY] - spread[:, 3:6],
                    x[:, VELOCITY] + spread[:, 3:6],
                )
                spin[bodies] = np.abs(x[:, ANGULAR_VELOCITY]) + spread[:, 9:12]
        return Bounds(low, high, slowest, fastest, spin)

    def _energies(self, bounds):
        """Return the largest kinetic energy that each body may have (B,) [J]."""
        speed = np.maximum(np.abs(bounds.slowest), np.abs(bounds.fastest))
        squares = np.sum(speed**2, axis=1) + self._stiffest * np.sum(bounds.spin**2, axis=1)
        return np.where(self._moving, 0.5 * self._heaviest * squares, 0.0)

    def _boxes(self, bounds, time, labels, energy, contact):
        """Return boxes that bodies do not leave for a time: lowest and highest corners, each (B, 3).

        ``energy`` (B,) is the energy of each body's island. Falling increases the energy of M kilograms, so
        that ``sqrt(2 E) <= sqrt(2 E_0) + sqrt(M) g t``. One body may have all of it.
        """
        gravity, fall = self._scene.gravity, 0.5 * time * (time + self._scene.dt)
        low = bounds.low + np.minimum(bounds.slowest, 0.0) * time + np.minimum(gravity, 0.0) * fall
        high = bounds.high + np.maximum(bounds.fastest, 0.0) * time + np.maximum(gravity, 0.0) * fall
        mass = np.bincount(labels, np.where(self._moving, self._heaviest, 0.0), len(labels))[labels]
        travel = (np.sqrt(2.0 * energy) * time + np.sqrt(mass) * self._gravity * fall) / np.sqrt(
            self._lightest
        )
        travel = travel[:, None]
        contact = contact[:, None]
        low, high = np.where(contact, bounds.low - travel, low), np.where(contact, bounds.high + travel, high)
        fixed = ~self._moving[:, None]
        low, high = np.where(fixed, bounds.low, low), np.where(fixed, bounds.high, high)
        reach = self._reach(bounds, time, labels, energy, contact[:, 0], mass)[:, None]
        return low - reach, high + reach

    def _reach(self, bounds, time, labels, energy, contact, mass):
        """Return how far from its centre of mass each body may affect others (B,) [m].

        The implicit step computes bodies together that may come close within a step
        (`contact_search.find_groups`). Such bodies must share an island.
        """
        if self._scene.integrator == "explicit":
            return self._radius
        # all of the energy may be in any motion; a body in flight keeps that of its rotation, and its angular
        # momentum
        grown = np.sqrt(2.0 * energy) + np.sqrt(mass) * self._gravity * time
        speed = (
            np.linalg.norm(np.maximum(np.abs(bounds.slowest), np.abs(bounds.fastest)), axis=1)
            + self._gravity * time
        )
        speed = np.where(contact, grown / np.sqrt(self._lightest), speed)
        spin = np.linalg.norm(bounds.spin, axis=1) * np.sqrt(self._stiffest / self._softest)
        spin = np.where(contact, grown / np.sqrt(self._lightest * self._softest), spin)
        pace = np.where(self._moving, speed + self._radius * spin + self._gravity * self._scene.dt, 0.0)
        thrown = np.zeros(len(pace))
        np.maximum.at(thrown, labels[contact], pace[contact])
        thrown = np.where(contact, thrown[labels], 0.0)
        return self._radius + self._scene.dt * (pace + thrown) + NEAR

    def _plan(self, carry):
        """Begin a slice: choose its end, join islands that may meet, and add fixed bodies within reach."""
        scene = self._scene
        bounds = self._bounds(carry.islands, self._present(carry))
        energies = self._energies(bounds)
        labels = -1 - np.arange(len(scene.bodies))
        known = np.zeros(len(scene.bodies))
        for k, island in enumerate(carry.islands):
            own = island.bodies[self._moving[island.bodies]]
            labels[own] = k
            known[own] = max(island.energy, energies[own].sum())
        labels = np.unique(labels, return_inverse=True)[1]
        limit = next(end for end in self._ends if end > carry.step) - carry.step
        steps = min(limit, _LONGEST)
        while True:
            labels, meeting, pairs, contact = self._meeting(
                bounds, steps * scene.dt, labels, known, steps <= _SHORTEST
            )
            if not meeting:
                break
            steps = max(steps // 2, min(_SHORTEST, limit))
        parts = {}
        for island in carry.islands:
            parts.setdefault(labels[island.bodies[self._moving[island.bodies]][0]], []).append(island)
        islands = []
        for label, joining in sorted(parts.items()):
            own = np.flatnonzero((labels == label) & self._moving)
            of_own = labels[pairs] == label
            near = pairs[of_own.any(axis=1) & ~of_own.all(axis=1)]
            bodies = np.unique(
                np.concatenate([own, near[labels[near] != label], *(island.bodies for island in joining)])
            )
            if len(joining) == 1 and len(bodies) == len(joining[0].bodies):
                now = joining[0].carry
            else:
                now = self._joined(joining, bodies)
            energy = sum(max(island.energy, energies[island.bodies].sum()) for island in joining)
            alone = len(bodies) == 1 and not contact[own[0]] and self._can_fly
            islands.append(Island(bodies, self._part(bodies), now, energy, alone))
        return IslandsCarry(
            tuple(islands),
            tuple(island.carry for island in islands),
            carry.step,
            carry.step + steps,
            carry.step,
        )

    def _meeting(self, bounds, time, labels, energy, merge):
        """Find islands that may meet within a time, and join them if they are to ``merge``.

        Returns labels (B,) of the islands; whether different islands may meet; pairs (n, 2) of bodies that
        may touch, at least one of which moves; and which bodies (B,) may touch something.
        """
        moving = self._moving
        contact = moving & (np.bincount(labels, moving, len(labels))[labels] > 1)
        while True:
            low, high = self._boxes(bounds, time, labels, energy, contact)
            pairs = _overlapping(low, high)
            pairs = pairs[moving[pairs].any(axis=1)]
            touching = moving & self._reaches_elements(low, high)
            touching[pairs] |= moving[pairs]
            both = pairs[moving[pairs].all(axis=1)]
            meet = both[labels[both[:, 0]] != labels[both[:, 1]]]
            if len(meet) and not merge:
                return labels, True, pairs, contact
            if len(meet) == 0 and not (touching & ~contact).any():
                return labels, False, pairs, contact
            if len(meet):
                # each island's energy counts once
                members, first = np.unique(labels[moving], return_index=True)
                own = np.zeros(len(labels))
                own[members] = energy[moving][first]
                new = merged(labels, labels[meet])
                total = np.zeros(len(labels))
                np.add.at(total, merged(np.arange(len(labels)), labels[meet])[members], own[members])
                energy = np.where(moving, total[new], 0.0)
                labels = new
            contact = contact | touching

    def _reaches_elements(self, low, high):
        """Return whether each box may touch an element of the environment (B,)."""
        environment = self._scene.world.environment
        found = np.zeros(len(low), bool)
        if environment is None:
            return found
        center, half = 0.5 * (low + high), 0.5 * (high - low)
        for e in range(len(environment.kind)):
            # in the element's frame
            lowest, highest = bounds(environment.kind, environment.size, e)
            middle, reach = (
                (center - environment.position[e]) @ environment.R[e],
                half @ np.abs(environment.R[e]),
            )
            found |= np.all((middle - reach < highest) & (middle + reach > lowest), axis=1)
        return found

    def _close(self, carry):
        """End a slice, or begin it again if its energy exceeds the bounds of its plan."""
        present = self._present(carry)
        if len(carry.islands) > 1:
            # free flight has the planned energy
            met = [k for k, island in enumerate(carry.islands) if not island.alone]
            energies = self._energies(
                self._bounds([carry.islands[k] for k in met], [present[k] for k in met])
            )
            time = (carry.end - carry.begin) * self._scene.dt
            known = [island.energy for island in carry.islands]
            for k in met:
                island = carry.islands[k]
                mass = self._heaviest[island.bodies[self._moving[island.bodies]]].sum()
                most = (np.sqrt(2.0 * island.energy) + np.sqrt(mass) * self._gravity * time) ** 2 / 2.0
                now = energies[island.bodies].sum()
                if now > most * (1.0 + _ROUND_OFF):
                    known[k] = now
            if any(new > island.energy for new, island in zip(known, carry.islands, strict=True)):
                islands = tuple(
                    island._replace(energy=e) for island, e in zip(carry.islands, known, strict=True)
                )
                began = IslandsCarry(
                    islands, tuple(i.carry for i in islands), carry.begin, carry.begin, carry.begin
                )
                again = self._plan(began)
                if len(again.islands) < len(islands) or again.end < carry.end:
                    return again
        islands = tuple(
            island._replace(carry=now, alone=False)
            for island, now in zip(carry.islands, present, strict=True)
        )
        return IslandsCarry(islands, present, carry.end, carry.end, carry.end)


def _restricted(belief, bodies):
    """Return the belief about some bodies."""
    moving = np.flatnonzero(np.isin(bodies, belief.moving))
    place = np.searchsorted(belief.moving, bodies[moving])
    if belief.independent:
        P = belief.covariance[place]
    else:
        count = len(belief.moving)
        P = belief.covariance.reshape(count, ERROR, count, ERROR)[
            np.ix_(place, range(ERROR), place, range(ERROR))
        ]
        P = P.reshape(ERROR * len(moving), ERROR * len(moving))
    return Belief.trusted(belief.mean[bodies], P, moving)


def _in_contact(memory):
    """Return pairs of bodies with a contact in the solver's memory, as bodies at rest have at time 0."""
    if memory is None:
        return np.empty((0, 2), np.int64)
    known = np.arange(memory.contact.shape[1]) < memory.count[:, None]
    pairs = memory.contact[known][:, :2].astype(np.int64)
    return np.unique(np.sort(pairs[pairs[:, 1] >= 0], axis=1), axis=0)


def _correlated(belief):
    """Return pairs of bodies whose beliefs are correlated."""
    if belief.independent:
        return np.empty((0, 2), np.int64)
    count = len(belief.moving)
    some = np.any(belief.covariance.reshape(count, ERROR, count, ERROR) != 0.0, axis=(1, 3))
    return belief.moving[np.argwhere(np.triu(some, 1))]


def merged(labels, pairs):
    """Return the labels after joining each of some pairs of them."""
    root = np.arange(len(labels))

    def find(a):
        while root[a] != a:
            root[a] = root[root[a]]
            a = root[a]
        return a

    for a, b in sorted(set(map(tuple, np.asarray(pairs, np.int64).reshape(-1, 2).tolist()))):
        a, b = find(a), find(b)
        root[max(a, b)] = min(a, b)
    return np.array([find(label) for label in labels.tolist()])


def _overlapping(low, high):
    """Return pairs (n, 2) of boxes that overlap, by a sweep along x."""
    order = np.argsort(low[:, 0], kind="stable")
    ends = np.searchsorted(low[order, 0], high[order, 0], side="left")
    counts = np.maximum(ends - np.arange(1, len(order) + 1), 0)
    first = np.repeat(np.arange(len(order)), counts)
    second = first + 1 + np.arange(len(first)) - np.repeat(np.cumsum(counts) - counts, counts)
    a, b = order[first], order[second]
    across = np.all((low[a, 1:] < high[b, 1:]) & (low[b, 1:] < high[a, 1:]), axis=1)
    return np.sort(np.column_stack([a[across], b[across]]), axis=1)
