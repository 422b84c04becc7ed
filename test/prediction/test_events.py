"""Events: what they say of states, their margins, and how they combine."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from unc_physics import (
    AtRest,
    Belief,
    BodyBelief,
    Box,
    BoxRegion,
    Capsule,
    Cylinder,
    FellOff,
    InRegion,
    Plane,
    RigidBody,
    Scene,
    Sphere,
    Touches,
    UncPhysicsError,
    Upright,
    load_model,
)
from unc_physics.prediction.events import RolloutOutcomes, checked_events

TABLE = -0.5
SHELF = Box((0.4, 0.2, 0.02), (0.0, 0.0, -0.01), name="shelf")
ABOVE = BoxRegion("above", (0.4, 0.2, 0.4), (0.0, 0.0, 0.2))
BOX = load_model("salt_box").prefix(20)
SCENE = Scene.everyday(
    [RigidBody("box", BOX)], exact=True, environment=[Plane(offset=TABLE, name="floor"), SHELF]
)
BELIEF = Belief.of(SCENE, {"box": BodyBelief()})
ON_SHELF = InRegion("box", ABOVE)
WITH_POSTS = replace(
    SCENE,
    bodies=[*SCENE.bodies, *(RigidBody(name, BOX, fixed=True) for name in ("post", "pole"))],
    environment=[*SCENE.environment, Plane(normal=(1.0, 0.0, 1.0), name="slope")],
)


def test_events_are_what_they_say():
    rng = np.random.default_rng(0)
    states = np.zeros((200, 1, 13))
    states[:, 0, :3] = rng.uniform(-1.0, 1.0, (200, 3))
    turns = Rotation.random(200, rng)
    states[:, 0, 6:10] = turns.as_quat()
    for part in (slice(3, 6), slice(10, 13)):
        states[:, 0, part] = rng.normal(0.0, 0.02, (200, 3))
    start = BELIEF.mean.copy()
    held_turn = Rotation.from_euler("xyz", [0.4, -0.3, 1.0])
    start[0, 6:10], start[0, 2] = held_turn.as_quat(), 0.5
    outcomes = RolloutOutcomes(SCENE, start, states, np.full((200, 1, 3), np.inf))

    def lean(axis):
        return np.degrees(np.arccos(np.clip(turns.apply(axis)[:, 2], -1.0, 1.0)))

    np.testing.assert_array_equal(
        Upright("box").happened(outcomes), lean(held_turn.inv().apply([0.0, 0.0, 1.0])) < 45.0
    )
    on_its_side = Upright("box", axis=(2.0, 0.0, 0.0), angle=np.radians(20.0)).happened(outcomes)
    np.testing.assert_array_equal(on_its_side, lean([1.0, 0.0, 0.0]) < 20.0)
    speed, spin = (np.linalg.norm(states[:, 0, part], axis=1) for part in (slice(3, 6), slice(10, 13)))
    resting = AtRest("box", speed=0.03, angular_speed=0.04)
    np.testing.assert_array_equal(resting.happened(outcomes), (speed < 0.03) & (spin < 0.04))
    height = states[:, 0, 2]
    np.testing.assert_array_equal(FellOff("box").happened(outcomes), height < 0.5 - BOX.bounding_radius)
    np.testing.assert_array_equal(FellOff("box", drop=0.1).happened(outcomes), height < 0.4)
    np.testing.assert_array_equal(FellOff("box", "shelf").happened(outcomes), height < 0.0)
    np.testing.assert_array_equal(FellOff("box", "floor").happened(outcomes), height < TABLE)
    tilted = Box((0.4, 0.2, 0.02), (0.0, 0.0, 0.1), (0.0, np.sin(0.25), 0.0, np.cos(0.25)), name="ramp")
    post = RigidBody("post", load_model("can").prefix(20), fixed=True)
    scene = replace(SCENE, bodies=[*SCENE.bodies, post], environment=[tilted])
    states = np.concatenate([states, np.tile(np.eye(13)[9], (200, 1, 1))], axis=1)
    outcomes = RolloutOutcomes(scene, start, states, np.full((200, 2, 3), np.inf))
    top = 0.1 + 0.2 * np.sin(0.5) + 0.01 * np.cos(0.5)
    np.testing.assert_array_equal(FellOff("box", "ramp").happened(outcomes), height < top)
    top = (post.model.centers[:, 2] + post.model.radii).max()
    np.testing.assert_array_equal(FellOff("box", "post").happened(outcomes), height < top)


@pytest.mark.parametrize(
    ("support", "top"),
    [
        (Cylinder(0.1, 1.0, (0.0, 0.0, 0.1), (0.5, 0.5, 0.5, 0.5)), 0.2),
        # lying along x, and turned by 45 degrees about its own axis
        (
            Cylinder(
                0.1,
                1.0,
                (0.0, 0.0, 0.1),
                tuple((Rotation.from_euler("y", 90, True) * Rotation.from_euler("z", 45, True)).as_quat()),
            ),
            0.2,
        ),
        (
            Capsule(0.1, 0.5, (0.0, 0.0, 0.0), tuple(Rotation.from_euler("y", 45, True).as_quat())),
            0.1 + 0.25 * np.sqrt(0.5),
        ),
        (Sphere(0.1, (0.0, 0.0, 0.3)), 0.4),
    ],
)
def test_the_top_of_a_round_support_is_its_highest_point(support, top):
    scene = replace(SCENE, environment=[replace(support, name="support")])
    states = np.zeros((2, 1, 13))
    states[:, 0, 2], states[..., 9] = (top - 1e-5, top + 1e-5), 1.0
    outcomes = RolloutOutcomes(scene, BELIEF.mean, states)
    assert FellOff("box", "support").happened(outcomes).tolist() == [True, False]


def test_margins_are_medians_of_scaled_distances():
    """Of states in a slab along x and one along y, with unequal spreads; contacts have no distance."""
    rng, count = np.random.default_rng(0), 401
    states = np.zeros((count, 1, 13))
    states[..., 9] = 1.0
    states[:, 0, 0], states[:, 0, 1] = rng.normal(0.7, 0.1, count), rng.normal(-0.3, 0.4, count)
    touched = np.full((count, 1, 3), np.inf)
    touched[:350, 0, 1] = 0.1  # the floor, in most outcomes
    outcomes = RolloutOutcomes(SCENE, BELIEF.mean, states, touched)
    along_x, along_y = (
        InRegion("box", BoxRegion("slab", size)) for size in ((2.0, 1e3, 1e3), (1e3, 2.0, 1e3))
    )
    x, y = (1.0 - np.abs(states[:, 0, k]) for k in (0, 1))
    x, y = x / x.std(), y / y.std()
    hits, in_floor = Touches("box", "floor"), InRegion("box", BoxRegion("far", (1.0, 1.0, 1.0), (0, 0, 9)))
    for event, expected in (
        (along_x, np.median(x)),
        (~along_x, -np.median(x)),
        (along_x & along_y, np.median(np.minimum(x, y))),
        (along_x | along_y, np.median(np.maximum(x, y))),
        (along_x & ~along_y, np.median(np.minimum(x, -y))),
        (along_y & hits, np.median(y)),
        (in_floor, -8.0),  # certain, so that it has no spread: clipped
        (in_floor | hits, None),  # contacts decide, against the distance
        (~in_floor & ~hits, None),
        (hits, None),
    ):
        margin = event.margin(outcomes)
        assert margin == (None if expected is None else pytest.approx(expected)), str(event)


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (lambda: Upright("box", angle=0.0), "angle must be positive"),
        (lambda: Upright("box", angle=3.2), "angle must be at most pi"),
        (lambda: Upright("box", axis=(0.0, 0.0, 0.0)), "axis must have a direction"),
        (lambda: FellOff("box", "shelf", drop=1.0), "drop must not be given beside support"),
        (lambda: FellOff("box", drop=0.0), "drop must be positive"),
        (lambda: AtRest("box", speed=-1.0), "speed must be positive"),
        (lambda: AtRest("box", angular_speed=0.0), "angular_speed must be positive"),
        (lambda: InRegion("box", "above"), "region must be a BoxRegion, not a str"),
        (lambda: ON_SHELF & True, "must be an Event, not a bool"),
        (lambda: ON_SHELF | 1.0, "must be an Event, not a float"),
        (lambda: checked_events(3, SCENE), "events must be a sequence of Event"),
        (lambda: checked_events([ON_SHELF, "x"], SCENE), r"events\[1\] must be an Event, not a str"),
        *(
            (lambda event=event: checked_events([ON_SHELF, event], WITH_POSTS), rf"events\[1\]\.{words}")
            for event, words in (
                (Upright("cup"), "object names no body"),
                (Upright("cup") & Upright("box"), "object names no body"),
                (Upright("box") | Upright("cup"), "object names no body"),
                (~Touches("box", "cup"), "other is neither a body"),
                (Touches("box", "box"), "other must be another one"),
                (Touches("post", "pole"), "other is nothing that 'post' can touch"),
                (Touches("post", "shelf"), "other is nothing that 'post' can touch"),
                (FellOff("box", "box"), "support must be another one"),
                (~FellOff("box", "shelve"), "support is neither a body.*did you mean 'shelf'"),
                (FellOff("box", "slope"), "support is a plane that is not level"),
            )
        ),
    ],
)
def test_events_refuse_what_they_cannot_be(make, words):
    with pytest.raises(UncPhysicsError, match=words):
        make()


def test_a_body_that_moves_may_touch_one_that_does_not():
    for event in (Touches("post", "box"), Touches("box", "pole"), Touches("box", "slope")):
        assert checked_events(iter([event]), WITH_POSTS) == (event,)


@pytest.mark.parametrize("combine", [lambda a, b: a and b, lambda a, b: a or b, lambda a, b: not a])
def test_events_are_not_combined_by_words(combine):
    with pytest.raises(TypeError, match="combine events by &"):
        combine(Upright("box"), Touches("box", "floor"))
