"""Actions of a robot, as changes to a scene and to the belief about it."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import fields, replace
from typing import Any

import numpy as np

from ..checks.errors import InvalidRequestError, NotSupportedError, UncPhysicsError
from ..checks.names import hint
from ..scene.belief import Belief
from ..scene.body_belief import MEANS, STDS, BodyBelief
from ..scene.entries import ORIENTATION, ROLL_PITCH_YAW, at_field
from ..scene.environment import element_names
from ..scene.scene import Scene
from ..spatial.layout import ERROR, QUATERNION

#: An action: another belief; another scene and the belief about it; a function that makes them of those
#: given; or changes by the names of bodies and elements, each a `BodyBelief` or fields with their values.
Action = (
    Belief
    | tuple[Scene, Belief]
    | Callable[[Scene, Belief], tuple[Scene, Belief]]
    | Mapping[str, BodyBelief | Mapping[str, Any]]
)
_PLACES = MEANS | {ORIENTATION: QUATERNION}
#: Fields of a `BodyBelief`, which change the belief; all other fields change the body or the element itself.
OF_BELIEF = (*_PLACES, ROLL_PITCH_YAW, *STDS, "covariance", "origin")


def after_actions(
    scene: Scene,
    belief: Belief,
    actions: Mapping[str, Action] | Sequence[Action],
    prepare: Callable[[Scene, Belief], Any],
) -> dict[Any, Any]:
    """Return what ``prepare`` makes of the scene and the belief after each action, by name or number.

    Errors name the action.
    """
    if not actions:
        raise InvalidRequestError("must have at least one action", field="actions")
    named = actions if isinstance(actions, Mapping) else dict(enumerate(actions))
    found = {}
    for name, action in named.items():
        try:
            found[name] = prepare(*apply_action(scene, belief, action))
        except UncPhysicsError as error:
            raise about_action(name, error) from error
    return found


def about_action(name: str | int, error: UncPhysicsError) -> UncPhysicsError:
    """Return an error that names the action in front of its field."""
    return error.at(f"actions[{name!r}]" + (f": {error.field}" if error.field else ""))


def apply_action(scene: Scene, belief: Belief, action: Action) -> tuple[Scene, Belief]:
    """Return the scene and the belief after an action.

    Raises `UncPhysicsError` if the action is of another type, names an unknown body or element, or returns no
    scene or no belief.
    """
    if isinstance(action, Belief):
        return scene, action
    if isinstance(action, Mapping):
        return _with_changes(scene, belief, action)
    made = action(scene, belief) if callable(action) else action
    kinds = (Scene, Belief)
    if not (isinstance(made, tuple) and len(made) == 2 and all(map(isinstance, made, kinds))):
        if callable(action):
            raise InvalidRequestError("must return a Scene and a Belief", value=made)
        raise InvalidRequestError(
            "must be a Belief, a Scene and a Belief, a function that returns these, or a mapping of names to"
            " changes",
            value=made,
        )
    return made


def _with_changes(scene, belief, changes):
    """Return the scene and the belief with other fields of some bodies and elements."""
    bodies, elements = list(scene.bodies), list(scene.environment)
    names = [body.name for body in bodies] + element_names(elements)
    beliefs = {}
    for name, change in changes.items():
        if name not in names:
            raise InvalidRequestError(
                f"is neither a body nor an element of the environment{hint(str(name), names)}; the action's"
                f" keys are names of these: {', '.join(names)}",
                value=name,
            )
        k = names.index(name)
        if isinstance(change, BodyBelief):
            beliefs[k] = change
            continue
        if not isinstance(change, Mapping):
            raise InvalidRequestError("must be a BodyBelief, or fields and their values", field=repr(name))
        of_belief = {key: value for key, value in change.items() if key in OF_BELIEF and k < len(bodies)}
        of_thing = {key: value for key, value in change.items() if key not in of_belief}
        if of_belief:
            beliefs[k] = of_belief
        if of_thing:
            things, place = (bodies, k) if k < len(bodies) else (elements, k - len(bodies))
            things[place] = _replaced(things[place], of_thing, name)
    if bodies != list(scene.bodies) or elements != list(scene.environment):
        scene = replace(scene, bodies=bodies, environment=elements)
    return scene, _with_beliefs(scene, belief, beliefs)


def _replaced(thing, changes, name):
    """Return a body or an element with other fields."""
    known = [spec.name for spec in fields(thing) if spec.name != "name"]
    known += [key for key in OF_BELIEF if key not in known] if hasattr(thing, "model") else []
    for key in changes:
        if key not in known:
            raise InvalidRequestError(f"has no field '{key}'{hint(str(key), known)}", field=f"'{name}'")
    return replace(thing, **changes)


def _with_beliefs(scene, belief, changes):
    """Return the belief with changes of some bodies: a `BodyBelief`, or some of its fields."""
    same = np.array_equal(scene.moving, belief.moving)
    if not changes and same:
        return belief
    mean, moving = belief.mean.copy(), scene.moving.tolist()
    blocks = {b: belief.marginal(b).copy() for b in moving}
    spread = not same
    for b, change in changes.items():
        whole = isinstance(change, BodyBelief)
        if whole:
            given: BodyBelief = change
        else:
            # without an orientation of its own the body keeps the one that it has
            kept = {} if ROLL_PITCH_YAW in change else {ORIENTATION: mean[b, QUATERNION]}
            fields_of_it = {**kept, **change}
            given = at_field(repr(scene.bodies[b].name), BodyBelief, **fields_of_it)
        given = given.at_center_of_mass(scene.bodies[b].model.origin)
        if b not in blocks:
            at_field(repr(scene.bodies[b].name), given.check_fixed)
        named = (*_PLACES, "covariance") if whole else tuple(key for key in change if key != "origin")
        for key in (ORIENTATION if key == ROLL_PITCH_YAW else key for key in named):
            if key in _PLACES:
                mean[b, _PLACES[key]] = getattr(given, key)
                continue
            spread = True
            if b in blocks:
                own = STDS.get(key, slice(None))
                blocks[b][own], blocks[b][:, own] = 0.0, 0.0
                blocks[b][own, own] = given.covariance[own, own]
    if not spread:
        return Belief(mean, belief.covariance, belief.moving)
    if not belief.independent:
        raise NotSupportedError(
            "has one covariance for all bodies together, of which no body's own part can be changed; let the"
            " action be a Belief",
            field="belief",
        )
    P = np.array([blocks[b] for b in moving]).reshape(-1, ERROR, ERROR)
    return Belief(mean, P, scene.moving)
