"""Every flag is raised just above its limit and not just below it, for each body by its own value."""

import math
from copy import copy
from dataclasses import replace

import numpy as np
import pytest
from plain_scenes import BALL, PLATE, G, ball, energy, independent, lowest, state
from scipy.spatial.transform import Rotation

from unc_physics import Belief, Plane, RigidBody, Scene, Status, assess, make_propagator, predict
from unc_physics.prediction.diagnosis import is_inconclusive, may_miss, sampled_snapshots
from unc_physics.prediction.diagnostics import RULES, judged, mean_pose_errors, measures_of, raised
from unc_physics.prediction.driver import wide_states
from unc_physics.prediction.evidence import Evidence, initial_diagnostics
from unc_physics.scene.marks import mark_at
from unc_physics.spatial.moments import pose_spreads

LARGE = ball(0.08)
TILT = Rotation.from_euler("xyz", [0.7, -0.4, 1.1])  # of the axes along which spreads differ
TURN = Rotation.from_euler("xyz", [0.3, 0.9, -2.0]).as_quat()
#: By name: limit, flag, a function that returns evidence with a value of the measure for the first body, and
#: the shares of the limit that are tried. The measure is the first word of the name.
CASES = {}
OVERLAP, OUTSIDE = Status.INITIAL_OVERLAP, Status.OUTSIDE_VALIDITY
STEP, MEAN = Status.NOT_CONVERGED, Status.MEAN_NOT_POSSIBLE
#: Measures that are yes or no, or a whole number.
COUNTED = {"outcomes", "unchecked"}
#: Measures that bodies without any contact have, too.
OF_ALL = {
    *("overlap_kept", "overlap_moved", "unsettled", "rotation_std", "spread_disagreement"),
    *("mean_disagreement", "spread_error", "rare_outcomes", "missed_goal"),
}


def case(limit, flag, shares=(0.995, 1.005), of=(None,)):
    """Enter a function of the value, once for each argument ``of``."""

    def enter(make):
        for one in of:
            name = make.__name__ if one is None else f"{make.__name__} {one}"
            CASES[name] = limit, flag, (make if one is None else lambda v, one=one: make(v, one)), shares
        return make

    return enter


def evidence_of(scene, belief, propagator="sigma_points", horizon=0.01, **options):
    prediction = predict(scene, belief, make_propagator(propagator, **options), horizon)
    return Evidence.of(prediction, initial_diagnostics(prediction), prediction.at())


def spread(stds, orientation=(0, 0, 0, 1)):
    """A covariance (3, 3) with these standard deviations along tilted axes, about the axes of a body."""
    R = (Rotation.from_quat(orientation).inv() * TILT).as_matrix()
    return R @ np.diag(np.square(stds)) @ R.T


def blocks(count, **parts):
    """Covariances (count, 12, 12) with the given blocks (count, 3, 3), by the name of the error."""
    P = np.zeros((count, 12, 12))
    for k, name in enumerate(("position", "velocity", "rotation", "spin")):
        P[:, 3 * k : 3 * k + 3, 3 * k : 3 * k + 3] = parts.get(name, 0.0)
    return P


def believing(evidence, mean=None, P=None):
    """Return the evidence with another predicted belief."""
    own = evidence.snapshot.belief
    belief = Belief(own.mean if mean is None else mean, own.blocks if P is None else P, own.moving)
    return replace(evidence, snapshot=replace(evidence.snapshot, belief=belief))


def knowing(evidence, **values):
    """Return the evidence with values that it would compute."""
    evidence = copy(evidence)
    vars(evidence).update(values)
    return evidence


def on_floor(propagator="sigma_points", models=(BALL, LARGE), masses=(1.0, 1.0), std=0.001, **physics):
    """Two bodies that touch a floor, apart."""
    bodies = [RigidBody(name, *parts) for name, *parts in zip("ab", models, masses, strict=True)]
    scene = Scene.everyday(bodies, **{"exact": True, "environment": [Plane()]} | physics)
    states = [state((k, 0, -lowest(model))) for k, model in enumerate(models)]
    return evidence_of(scene, independent(*states, position=std), propagator)


def adjusted(field, values, samples=math.inf, at_rest=False):
    """Evidence of states with given adjustments (N, 2) at the start, in one field."""
    found = on_floor()
    first, other = found.scene.bodies
    scene = replace(found.scene, bodies=[replace(first, at_rest=at_rest), other])
    none = np.zeros(np.shape(values), np.float32)
    changes = dict.fromkeys(found.start.found._fields, none) | {field: np.array(values, np.float32)}
    start = found.start._replace(found=found.start.found._replace(**changes), samples=samples)
    return replace(found, scene=scene, start=start)


def kinetic_energy(scene, x):
    still = x.copy()
    still[:, 3:6] = still[:, 10:] = 0.0
    return energy(scene, x) - energy(scene, still)


def some(share, count, yes=1.0, no=0.0):
    """Values (count, 2): ``yes`` in a share of them for the first body, in half as many for the other."""
    values = np.full((count, 2), no)
    for k, own in enumerate((share, 0.5 * share)):
        values[: round(own * count), k] = yes
    return values


# -- the start ---------------------------------------------------------------------------------------


@case(0.01, OVERLAP, of=("by springs", "by samples"))
def overlap_kept(value, way):
    """Two balls that are closer than the sum of their radii; or what no sample could lose."""
    if way == "by samples":
        return adjusted("kept", [[0.0, 0.01 * 0.08], [0.05 * value, 0.0], [0.0, 0.0]])
    bodies = [RigidBody("a", BALL, 1.0), RigidBody("b", LARGE, 1.0), RigidBody("c", BALL, 1.0)]
    places = (0, 0, 0), (0, 0.13 - 0.05 * value, 0), (1, 0, 0)
    return evidence_of(Scene(bodies, dt=1e-3, stiffness=1e4), independent(*map(state, places)))


@case(0.01, OVERLAP)
def overlap_moved(value):
    return adjusted("moved", some(value, 20_000, 5.01, 4.99), samples=20_000)


@case(0.01, OVERLAP, of=("by points",))
def overlap_moved_(value, _):
    """Chosen points lie as far out as the root of half their number."""
    return adjusted("moved", some(value, 20_000, 101.1, 100.9))


@case(0.05, OVERLAP)
def unsettled(value):
    return adjusted("unsettled", some(value, 4000), at_rest=True)


# -- the spread --------------------------------------------------------------------------------------


@case(1.0, OUTSIDE)
def rotation_std(value):
    """The largest along any axis."""
    P = blocks(2, rotation=[spread((0.3, value, 0.5), TURN), spread((0.7, 0.9, 0.2))])
    scene = Scene([RigidBody("a", BALL, 1.0), RigidBody("b", BALL, 1.0)])
    found = evidence_of(scene, independent(state(orientation=TURN), state((1, 0, 0))), "linearization")
    return believing(found, P=P)


@case(1.0, OUTSIDE)
def rotation_std_(value):
    """That of four rollouts along two axes, if it is smaller."""
    found = rotation_std(1.5)
    states = np.tile(found.start.mean, (4, 1, 1))
    for axis, angle, n in ((0, 1.0, 0), (0, -1.0, 1), (1, 0.5, 2), (1, -0.5, 3)):
        turn = Rotation.from_quat(states[n, 0, 6:10]) * Rotation.from_rotvec(
            2**0.5 * angle * value * np.eye(3)[axis]
        )
        states[n, 0, 6:10] = turn.as_quat()
    return replace(found, compared=states)


def compared(value, below=False):
    """Evidence with spreads of rollouts: a factor for one body, and 1.3 times the floor of another."""
    found = on_floor()
    P = blocks(2, position=spread((0.01, 0.02, 0.03)), rotation=[spread((0.1, 0.2, 0.3)), np.zeros((3, 3))])
    P[1, :3, :3] = 0.0
    spreads = pose_spreads(P) * [[1.0, 1.0 / value if below else value], [0.0, 0.0]]
    return seen(believing(found, P=P), spreads=spreads + [[0.0, 0.0], [1.3 * 8e-5, 9e-4]])


def seen(evidence, mean=None, spreads=None):
    """Return the evidence with moments of rollouts that it is compared with."""
    own = evidence.snapshot.belief.mean if mean is None else mean
    moments = own, pose_spreads(evidence.snapshot.belief.blocks) if spreads is None else spreads
    return knowing(replace(evidence, compared=np.tile(own, (2, 1, 1))), compared_moments=moments)


@case(1.5, OUTSIDE, of=(True, False))
def spread_disagreement(value, below):
    return compared(value, below)


@case(0.5, OUTSIDE, of=("position", "rotation"))
def mean_disagreement(value, quantity):
    """Over the standard deviations of the rollouts along all axes."""
    found = on_floor()
    P = blocks(2, position=spread((0.01, 0.02, 0.02)), rotation=[spread((0.1, 0.2, 0.2)), np.zeros((3, 3))])
    mean = found.snapshot.belief.mean.copy()
    if quantity == "position":
        mean[0, :3] += value * 0.03 * np.array((2.0, -1.0, 2.0)) / 3.0
    else:
        turn = Rotation.from_rotvec(value * 0.3 * np.array((2.0, -1.0, 2.0)) / 3.0)
        mean[0, 6:10] = (turn * Rotation.from_quat(mean[0, 6:10])).as_quat()
    return seen(believing(found, P=P), mean)


@case(0.25, OUTSIDE, shares=(1.0, 4.0 / 14.0**0.5))
def spread_error_(value):
    """A standard deviation of N samples is known to one over the root of 2 (N - 1)."""
    scene = Scene([RigidBody("a", BALL, 1.0)])
    count = round(1.0 + 0.5 / value**2)
    return evidence_of(scene, independent(state(), position=0.1), "monte_carlo", samples=count)


@case(0.25, OUTSIDE)
def spread_error(value):
    return knowing(on_floor("cloud"), own_measures={"spread_error": np.array([value, 0.1])})


@case(1.05, OUTSIDE)
def missed_goal(value):
    return knowing(on_floor("auto"), own_measures={"missed_goal": np.array([value, 0.1])})


@case(1.4, OUTSIDE)
def rare_outcomes(value):
    return knowing(on_floor(), widening=np.array([[1.0, value], [1.3, 1.0]]))


# -- the mean ----------------------------------------------------------------------------------------


@case(1.0, MEAN, of=(5e-5, 1e-3, 5e-3))
def mean_penetration(value, std):
    """Below the overlap of the start by the largest standard deviation, or 0.2 mm, or 2 mm."""
    found = on_floor()
    mean = found.snapshot.belief.mean.copy()
    mean[:, 2] = 0.05 - 3e-4 - value * min(max(std, 2e-4), 2e-3), 0.08
    P = blocks(2, position=[spread((0.5 * std, std, 0.2 * std)), spread((0.1, 0.1, 0.1))])
    start = found.start._replace(overlap=np.array([3e-4, 0.0]))
    return replace(believing(found, mean, P), start=start, states=None)


# -- the physics -------------------------------------------------------------------------------------


@case(0.02, STEP)
def energy_error(value):
    """Of a ball that hits a turning plate; a third body has nothing to do with it."""
    bodies = [RigidBody("a", BALL, 0.3), RigidBody("b", PLATE, 1.0), RigidBody("c", BALL, 9.0)]
    scene = Scene(bodies, dt=1e-3, stiffness=1e5, gravity=(0.5, 0.0, -2.0))
    hitting = state((0, 0, 0.12), (0, 0, -1.0))
    belief = independent(hitting, state(spin=(0.3, 0.2, 0.1)), state((3, 0, 0), (0, 5, 0)))
    found = evidence_of(scene, belief, "linearization", 0.2)
    pair = replace(found.scene, bodies=bodies[:2])
    before, after = belief.mean.copy(), found.snapshot.belief.mean.copy()
    work = [0.3, 1.0] * ((after - before)[:2, :3] @ scene.gravity)
    begun, now = kinetic_energy(pair, before[:2]), kinetic_energy(pair, after[:2])
    wanted = begun + work.sum() + value * (begun + np.maximum(work, 0.0).sum())
    for part in (slice(3, 6), slice(10, 13)):
        after[:, part] *= math.sqrt(wanted / now)
    return believing(found, after)


@case(0.02, STEP)
def energy_error_(value):
    """Lost by two states of balls that fly and fall; known energy is that of the mean first contact."""
    found = on_floor(friction=0.0, restitution=1.0, std=0.0)
    start = found.start.mean.copy()
    start[:, 3] = 0.5, 0.2
    begun = 0.5 * start[:, 3] ** 2
    times = np.full((3, 2, 3), np.inf)
    times[:2, 0, 2], times[:, 1, 2] = (0.1, 0.3), (0.1, 0.2, 0.6)
    states = np.tile(start, (3, 1, 1))
    states[:, :, 2] -= [[0.1, 0.02], [0.02, 0.04], [0.03, 0.03]]
    work, known = G * np.array([0.05, 0.03]), begun + 0.5 * G**2 * np.array([0.2, 0.3]) ** 2
    kinetic = begun + work - G * 1e-3 - [value, 0.01] * known
    states[:, :, 3:6] = 0.0
    states[:, :, 4] = np.sqrt(2.0 * kinetic * [[0.5], [1.0], [1.5]])
    own = found.start._replace(mean=start, least_energy=begun)
    return replace(found, start=own, states=states, history=found.history._replace(first_time=times))


def fast(stiffness_of, models=(BALL, LARGE)):
    """Evidence of the explicit integrator, with a stiffness by the highest speed of the first body."""
    belief = independent(state((0, 0, 1), (2.0, 0, 0)), state((5, 0, 1), (0.1, 0, 0)))
    speed = math.sqrt(4.0 + 2.0 * G * 0.4)
    bodies = [RigidBody(name, *parts) for name, *parts in zip("ab", models, (1.0, 2.0), strict=True)]
    scene = Scene(bodies, dt=1e-3, gravity=(0, 0, -G), stiffness=stiffness_of(speed), environment=[Plane()])
    found = evidence_of(scene, belief)
    mean = belief.mean.copy()
    mean[:, :3] += [[0.1, -0.4, 0.3], [0.0, 0.0, 0.0]]
    mean[:, 3:6] = [[0.0, 1.0, 0.0], [0.0, 0.0, 0.2]]
    return knowing(believing(found, mean), touches=np.array([True, True]))


@case(1.0, STEP)
def impact_over_capacity(value):
    return fast(lambda speed: 0.5 * speed**2 / value / (math.pi * 0.05**4))


@case(2e-4, OUTSIDE)
def squeezed(value):
    """That one in twenty rollouts exceeds."""
    found = on_floor()
    depths = np.zeros((101, 2, 3))
    depths[95:, 0, 0], depths[96:, 1, 0] = value, 9.0
    depths[:, :, 1:] = 1, 2
    return replace(
        found, history=found.history._replace(solver=found.history.solver._replace(squeezed=depths))
    )


# -- all ---------------------------------------------------------------------------------------------


#: Their cases below and above the limits need rollouts, and are in `test_status_of_steps.py`.
OF_STEPS = {"step_motion"}


def test_every_flag_with_a_limit_has_a_case():
    assert {name for name, rule in RULES.items() if math.isfinite(rule.limit)} - COUNTED - OF_STEPS == {
        name.split()[0].rstrip("_") for name in CASES
    }


@pytest.mark.parametrize("name", CASES)
def test_a_flag_is_raised_above_its_limit_alone(name):
    limit, flag, make, shares = CASES[name]
    measure = name.split()[0].rstrip("_")
    for share in shares:
        evidence = make(share * limit)
        found = measures_of(evidence)
        assert found[0][measure] == pytest.approx(share * limit, rel=1e-4)
        for k, own in enumerate(found):
            value = own.get(measure, 0.0)
            assert (value > limit) == (share > 1.0 and (k == 0 or value == found[0][measure]))
            assert (measure in raised(own)) == (value > limit)
            status = judged(evidence, k, own)
            assert value <= limit or status.flags & flag
            assert any(f"({measure} " in reason for reason in status.reasons) == (value > limit)
        apart = knowing(evidence, touches=np.arange(len(found)) > 0)
        assert (measure in measures_of(apart)[0]) == (measure in OF_ALL)


def test_a_rotation_and_a_mean_pose_count_less_two_of_their_standard_errors():
    found = rotation_std(1.5)
    for error, expected in ((0.1, 1.2), (0.6, 0.0)):
        own = knowing(found, own_measures={"spread_error": np.full(2, error)})
        assert measures_of(own)[0]["rotation_std"] == pytest.approx(expected)


def test_a_body_that_does_not_move_has_no_measures():
    scene = Scene([RigidBody("a", BALL, fixed=True), RigidBody("b", BALL, 1.0)])
    belief = Belief([state(), state((1, 0, 0))], np.zeros((1, 12, 12)), [1])
    fixed, free = measures_of(evidence_of(scene, belief, "linearization"))
    assert not fixed and free


# -- the comparison with rollouts --------------------------------------------------------------------


def test_spreads_below_their_floors_are_alike():
    """The floors are 0.1 mrad, and as much of the radius."""
    for below in (False, True):
        assert compared(2.5, below).spread_factors == pytest.approx(np.array([[1.0, 2.5], [1.3, 1.0]]))
    (reason,) = judged(compared(2.5), 0, {"spread_disagreement": 2.5}).reasons
    assert f"rotation {0.14**0.5:.3g} rad predicted, {2.5 * 0.14**0.5:.3g} rad in rollouts; " in reason
    (reason,) = judged(compared(2.5), 1, {"spread_disagreement": 2.5}).reasons
    assert "position 0 m predicted, 0.000104 m in rollouts (less than 8e-05 m counts as 8e-05 m)" in reason


@pytest.mark.parametrize(
    ("factor", "shift", "inconclusive"),
    [(1.14, 0.24, False), (1.16, 0.0, True), (99.0, 0.0, True), (1.0, 0.26, True)],
)
def test_a_comparison_is_inconclusive_unless_all_bodies_agree(factor, shift, inconclusive):
    """The spread of the other body is below its floor."""
    found = compared(factor)
    spreads = np.array(found.compared_moments[1])
    spreads[1] = 0.0
    mean = found.snapshot.belief.mean.copy()
    mean[0, 0] += shift * spreads[0, 0]
    assert is_inconclusive(seen(found, mean, spreads)) == inconclusive
    assert not is_inconclusive(on_floor())


def test_an_inconclusive_comparison_is_of_all_rollouts():
    """A ball that meets a wall or not, by linearization; the spread is that of 12 and 24 more rollouts."""
    bodies = [RigidBody("a", BALL, 1.0), RigidBody("b", LARGE, 1.0)]
    scene = Scene(bodies, dt=1e-3, stiffness=1e6)
    belief = independent(
        state((0, 0, 0), (1, 0, 0)), state((0.3, 0.125, 0)), position=(0, 0.01, 0), velocity=0.02
    )
    prediction = predict(scene, belief, "linearization", 0.5)
    few, more = (
        sampled_snapshots(prediction.scene, belief, [mark_at(0.5, 1e-3)], count, seed)[0].rollout_states
        for count, seed in ((12, 0), (24, 1))
    )

    def factor(*states):
        std = np.sqrt(np.concatenate(states)[:, :, :3].var(axis=0).sum(axis=1))
        own = pose_spreads(prediction.belief.blocks)[:, 0]
        return np.maximum(std / own, own / std)

    assert (factor(few) > 1.15).any(), "the case must be inconclusive"
    found = [status.measures["spread_disagreement"] for status in assess(prediction)]
    assert found == pytest.approx(np.maximum(factor(few, more), 1.0), rel=1e-6)
    assert found != pytest.approx(factor(few), rel=1e-2)


@pytest.mark.parametrize(
    ("propagator", "options", "physics", "std", "searched"),
    [
        ("cloud", {}, {}, 1e-3, True),
        ("cloud", {}, {}, 0.0, False),
        ("linearization", {}, {}, 1e-3, False),
        ("monte_carlo", {"samples": 999}, {}, 1e-3, True),
        ("monte_carlo", {"samples": 1000}, {}, 1e-3, False),
        ("sigma_points", {}, {"integrator": "explicit", "dt": 0.01}, 1e-3, False),
    ],
)
def test_rare_outcomes_are_searched_for_where_few_rollouts_may_miss_them(
    propagator, options, physics, std, searched
):
    scene = Scene([RigidBody("a", BALL, 1.0)], **{"integrator": "implicit", "dt": 0.01} | physics)
    prediction = predict(
        scene, independent(state(), position=std), make_propagator(propagator, **options), 0.01
    )
    assert may_miss(prediction) == searched


@pytest.mark.parametrize(("count", "drawn"), [(10, 10), (40, 24)])
def test_wide_rollouts_have_twice_the_spread_at_each_mark(count, drawn):
    bodies = [RigidBody("a", BALL, 1.0), RigidBody("b", LARGE, 1.0)]
    scene = Scene(bodies, integrator="implicit", dt=0.01)
    belief = independent(
        state((0, 0, 0), (1, 0, 0)), state((5, 0, 0), (0, 2, 0)), position=(0.01, 0.02, 0.03)
    )
    marks = [mark_at(time, 0.01) for time in (0.1, 0.3)]
    for mark, states in zip(marks, wide_states(scene, belief, marks, count), strict=True):
        assert states is not None and states.shape == (drawn, 2, 13)
        mean = [[mark.time, 0, 0], [5, 2 * mark.time, 0]]
        assert states[:, :, :3].mean(axis=0) == pytest.approx(np.array(mean), abs=0.02)
        assert states[:, :, :3].std(axis=0) == pytest.approx(np.tile([0.02, 0.04, 0.06], (2, 1)), rel=1e-6)


def test_the_mean_pose_has_the_errors_of_what_it_touches():
    """Standard errors along one axis, of two balls that touch each other and of a third one."""
    bodies = [RigidBody(name, model, 1.0) for name, model in zip("abc", (BALL, LARGE, BALL), strict=True)]
    scene = Scene.everyday(bodies, exact=True, gravity=None, environment=[Plane(offset=-9.0)])
    belief = independent(*(state((x, 0, 0)) for x in (0.0, 5.0, 9.0)), position=0.01, rotation=0.1)
    found = evidence_of(scene, belief, "monte_carlo", samples=100)
    touched = np.zeros((3, 4), bool)
    touched[0, 1] = touched[1, 3] = True
    position, rotation = pose_spreads(found.snapshot.belief.blocks).T / 10.0
    own = (position**2 + (np.array([0.05, 0.08, 0.05]) * rotation) ** 2) / 3.0
    expected = np.sqrt(own + [own[1], own[0], 0.0])
    assert mean_pose_errors(knowing(found, touched=touched)) == pytest.approx(expected)
