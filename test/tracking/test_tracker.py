"""The tracker beside a Kalman filter, least squares and simulated truths."""

from dataclasses import replace

import numpy as np
import pytest
from plain_scenes import state
from scipy.spatial.transform import Rotation
from tracked_scenes import NOISE, SIDE, belief_of, bodies, box, free_scene, measured, pose, table_scene

from unc_physics import (
    AxialSymmetry,
    Belief,
    BodyBelief,
    ContactNoise,
    Plane,
    PoseMeasurement,
    PosePath,
    PositionMeasurement,
    RelativePoseMeasurement,
    RigidBody,
    Scene,
    Status,
    Touches,
    Tracker,
    TrackStatus,
    UncPhysicsError,
    load_model,
    make_propagator,
    predict,
)

RATE = 30.0
UNKNOWN = {
    "position_std": 1.0,
    "orientation_std": 1.0,
    "linear_velocity_std": 2.0,
    "angular_velocity_std": 15.0,
}
STDS = tuple(UNKNOWN)
AHEAD = PosePath(times=[0.0, 1.0], positions=[(0, 0, 0), (0, 0, 1)])
RESTING = pose([0.0, 0.0, SIDE / 2])


def simulated(scene, start, times):
    """True states (T, B, 13) at some times."""
    belief = Belief(start, np.zeros((len(scene.moving), 12, 12)))
    found = predict(scene, belief, make_propagator("monte_carlo", samples=1), times=times)
    return np.array([found.samples(time=time)[0] for time in times])


def flight(known, velocity, spin, times, gravity=-9.81):
    """Poses (T, 7) of a free flight."""
    p0 = np.asarray(known, float)
    turn = Rotation.from_rotvec(np.outer(times, spin))
    p = p0 + np.outer(times, velocity) + 0.5 * np.outer(times**2, [0.0, 0.0, gravity])
    return np.concatenate([p, turn.as_quat()], axis=1)


def test_free_flight_equals_the_linear_kalman_filter():
    scene = free_scene()
    belief = belief_of(scene, box0={"orientation_std": 0.0, "angular_velocity_std": 0.0})
    tracker, rng = Tracker(scene, belief), np.random.default_rng(0)
    mean, P = np.zeros(6), np.diag(np.r_[np.full(3, 0.003), np.full(3, 0.05)] ** 2)
    F, H, R = np.eye(6), np.eye(3, 6), 4e-6 * np.eye(3)
    F[:3, 3:] = np.eye(3) / RATE
    for k in range(1, 31):
        z = np.array([0.04, -0.02, 0.01]) * k / RATE + 2e-3 * rng.standard_normal(3)
        tracker.correct(k / RATE, {"box0": PositionMeasurement(z, R)})
        mean, P = F @ mean, F @ P @ F.T
        S = H @ P @ H.T + R
        K = P @ H.T @ np.linalg.inv(S)
        mean, P = mean + K @ (z - mean[:3]), P - K @ H @ P
        found = tracker.belief()
        assert found.mean[0, :6] == pytest.approx(mean, abs=1e-9)
        assert found.covariance[:6, :6] == pytest.approx(P, abs=1e-11)


def test_an_exact_stamp_between_two_steps():
    scene = free_scene()
    belief = belief_of(scene, box0={"linear_velocity": [1.0, 0.0, 0.0], "linear_velocity_std": 1e-6})
    tracker = Tracker(scene, belief)
    late = 10.4 / 240.0
    tracker.correct(late, {"box0": PositionMeasurement([late, 0.0, 0.0], np.full(3, 1e-5))})
    assert tracker.belief().mean[0, 0] == pytest.approx(late, abs=1e-6)


def test_velocities_are_learned_as_well_as_by_least_squares():
    scene, errors, best = table_scene(), [], []
    times = np.arange(10) / RATE
    for seed in range(12):
        rng = np.random.default_rng(seed)
        truth = flight([0.0, 0.0, 1.2], [0.8, -0.3, 1.0], [2.0, -3.0, 1.0], times)
        tracker = Tracker(scene, belief_of(scene, box0={**UNKNOWN, "position": truth[0, :3]}))
        seen = [measured(x, rng) for x in truth]
        for time, one in zip(times, seen, strict=True):
            report = tracker.correct(time, {"box0": one})
        assert report.status["box0"] is TrackStatus.TRACKED
        assert not report.rejected
        true_velocity = np.array([0.8, -0.3, 1.0 - 9.81 * times[-1]])
        errors.append(tracker.belief().mean[0, 3:6] - true_velocity)
        p = np.array([one.pose[:3] for one in seen]) - 0.5 * np.outer(times**2, [0.0, 0.0, -9.81])
        best.append(np.polyfit(times, p, 1)[0] - [0.8, -0.3, 1.0])
    assert np.sqrt(np.mean(np.square(errors))) < 1.1 * np.sqrt(np.mean(np.square(best)))


def test_a_still_body_keeps_its_spread_and_its_place():
    scene, rng = table_scene(), np.random.default_rng(1)
    tracker = Tracker(scene, belief_of(scene, box0={"position": RESTING[:3]}))
    for k in range(1, 121):
        report = tracker.correct(k / RATE, {"box0": measured(RESTING, rng)})
        assert not report.rejected
        if k > 30:
            belief = tracker.belief()
            std = np.sqrt(belief.covariance.diagonal())
            assert np.linalg.norm(belief.mean[0, :3] - RESTING[:3]) < 2e-3
            assert std[:2].min() > 2e-4
            assert std[:3].max() < NOISE[0]
    assert report.status["box0"] is TrackStatus.RESTING
    tracker.predict(10.0)  # nobody looks for six seconds
    assert tracker.status("box0") is TrackStatus.RESTING
    assert np.linalg.norm(tracker.belief().mean[0, :3] - RESTING[:3]) < 2e-3


def test_late_and_reordered_measurements_give_the_bits_of_those_in_order():
    """And their distances from what was expected then; those before the window have no effect."""
    scene, rng = table_scene(), np.random.default_rng(3)
    belief = belief_of(scene, box0={"position": [0.0, 0.0, 0.1], "linear_velocity": [0.5, 0.0, 0.0]})
    times = np.arange(1, 13) / RATE
    seen = [measured(x[0], rng) for x in simulated(scene, belief.mean, times)]
    in_order, mixed = (Tracker(scene, belief, window=0.2) for _ in range(2))
    distances = [in_order.correct(times[k], {"box0": seen[k]}).distance for k in range(12)]
    order = [0, 2, 1, 3, 7, 4, 5, 6, 8, 11, 10, 9]
    reports = [mixed.correct(times[k], {"box0": seen[k]}) for k in order]
    assert [report.replayed for report in reports] == [0, 0, 1, 0, 0, 1, 1, 1, 0, 0, 1, 2]
    assert [reports[k].distance for k in (2, 11)] == [distances[k] for k in (1, 9)]
    before = mixed.samples()
    assert mixed.correct(0.15, {"box0": seen[0]}).too_late
    np.testing.assert_array_equal(in_order.samples(), before)
    np.testing.assert_array_equal(mixed.samples(), before)
    assert not mixed.correct(0.25, {"box0": seen[6]}).too_late
    assert not np.array_equal(Tracker(scene, belief, seed=1).samples(), Tracker(scene, belief).samples())


def test_a_hand_is_followed_and_let_go():
    scene, rng = table_scene(), np.random.default_rng(7)
    tracker = Tracker(scene, belief_of(scene, box0={"position": RESTING[:3]}))
    errors, statuses = {}, {}
    for k in range(1, 121):
        t = k / RATE
        z = SIDE / 2 + 0.4 * min(max(t - 1.0, 0.0), 1.0)  # lifted for a second, then held, then dropped
        if t > 2.5:
            z = max(z - 0.5 * 9.81 * (t - 2.5) ** 2, SIDE / 2)
        truth = pose([0.0, 0.0, z])
        report = tracker.correct(t, {"box0": measured(truth, rng)})
        errors[k] = np.linalg.norm(tracker.belief().mean[0, :3] - truth[:3])
        statuses[k] = report.status["box0"]
    assert TrackStatus.CARRIED not in [statuses[k] for k in range(1, 30)]
    assert statuses[45] is TrackStatus.CARRIED
    assert max(errors[k] for k in range(34, 72)) < 8e-3
    assert statuses[120] is TrackStatus.RESTING
    assert errors[120] < 2e-3


def smooth(share):
    """From 0 to 1 without a jump of the velocity."""
    share = np.clip(share, 0.0, 1.0)
    return share**2 * (3.0 - 2.0 * share)


def lifted(t):
    """A hand lifts the box at 0.2 m/s, moves it by 0.3 m, and puts it down."""
    z = 0.2 * (np.clip(t - 1.0, 0.0, 1.0) - smooth((t - 3.2) / 1.0))
    return [0.3 * smooth((t - 1.8) / 1.2), 0.0, SIDE / 2 + z]


def pushed(t):
    """A hand pushes the box at 0.1 m/s for 3 s."""
    return [0.1 * np.clip(t - 1.0, 0.0, 3.0), 0.0, SIDE / 2]


@pytest.mark.parametrize(
    ("path", "rate", "begins", "stops"),
    [(lifted, 10.0, 0.2, 4.1), (lifted, 30.0, 0.2, 4.1), (pushed, 10.0, 0.4, 4.0), (pushed, 30.0, 0.2, 4.0)],
)
def test_a_body_is_carried_from_when_a_hand_moves_it_until_it_rests(path, rate, begins, stops):
    """At 10 Hz two measurements must show that it moves: 10 mm in the first are too few."""
    for seed in range(3):
        scene, rng = table_scene(), np.random.default_rng(seed)
        tracker = Tracker(scene, belief_of(scene, box0={"position": RESTING[:3]}))
        found = {}
        for t in (np.arange(1, round(6.0 * rate) + 1) / rate).tolist():
            found[t] = tracker.correct(t, {"box0": measured(pose(path(t)), rng)}).status["box0"]
        carried = [t for t, status in found.items() if status is TrackStatus.CARRIED]
        assert 1.0 < carried[0] <= 1.0 + begins + 1e-9, (seed, carried)
        assert stops <= carried[-1] + 1e-9 <= stops + 0.9, (seed, carried)
        between = {status for t, status in found.items() if carried[0] <= t <= carried[-1]}
        assert between == {TrackStatus.CARRIED}, (seed, found)
        assert [status for t, status in found.items() if t > 5.0] == [TrackStatus.RESTING] * round(rate)


def test_single_outliers_are_rejected_and_a_moved_body_is_found_again():
    scene, rng = table_scene(), np.random.default_rng(8)
    tracker = Tracker(scene, belief_of(scene, box0={"position": RESTING[:3]}))
    for k in range(1, 31):
        if k in (10, 17, 18):
            report = tracker.correct(k / RATE, {"box0": measured(pose(rng.uniform(0.3, 1.0, 3)), rng)})
            assert report.rejected == ("box0",)
        else:
            report = tracker.correct(k / RATE, {"box0": measured(RESTING, rng)})
            assert report.rejected == ()
        assert np.linalg.norm(tracker.belief().mean[0, :3] - RESTING[:3]) < 5e-3
    moved = pose([0.4, 0.3, SIDE / 2])
    reports = [tracker.correct((30 + k) / RATE, {"box0": measured(moved, rng)}) for k in range(1, 61)]
    assert [report.rejected for report in reports[:3]] == [("box0",)] * 2 + [()]
    assert np.linalg.norm(tracker.belief().mean[0, :3] - moved[:3]) < 3e-3
    assert reports[-1].status["box0"] is TrackStatus.RESTING


def test_ahead_and_fork_leave_the_tracker_as_it_is():
    scene, rng = table_scene(), np.random.default_rng(11)
    belief = belief_of(scene, box0={"position": [0.0, 0.0, 0.3]})
    tracker = Tracker(scene, belief)
    tracker.correct(0.1, {"box0": measured(pose([0.0, 0.0, 0.251]), rng)})
    before = tracker.samples()
    prediction = tracker.ahead([0.05, 0.4])
    few = tracker.ahead([0.05, 0.4], members=16)  # 5 cm above the table at first, where nothing else is drawn
    assert np.array_equal(few.at(0.05).samples, prediction.at(0.05).samples[::4])
    assert few.propagator.samples == 16 and few["box0"].position[2] == pytest.approx(SIDE / 2, abs=2e-3)
    other = tracker.fork()
    other.correct(0.2, {"box0": measured(pose([0.0, 0.0, 0.104]), rng)})
    assert np.array_equal(tracker.samples(), before)
    assert tracker.time == 0.1
    assert prediction.times == pytest.approx((0.05, 0.4), abs=0.5 * scene.dt)
    assert prediction["box0"].position[2] == pytest.approx(SIDE / 2, abs=2e-3)
    tracker.predict(0.5)
    assert np.array_equal(tracker.samples(), prediction.samples())
    touched = prediction.contact_time(Touches("box0", "table"))
    assert touched is not None
    assert touched.mean == pytest.approx(np.sqrt(2.0 * 0.26 / 9.81) - 0.1, abs=0.02)


def test_bodies_come_and_go():
    scene, rng = table_scene(), np.random.default_rng(12)
    tracker = Tracker(scene, belief_of(scene, box0={"position": RESTING[:3]}))
    for k in range(1, 16):
        tracker.correct(k / RATE, {"box0": measured(RESTING, rng)})
    beside = pose([0.3, 0.0, SIDE / 2])
    unknown = UNKNOWN | {"position_std": 0.003, "orientation_std": 0.02}
    ends = beside, pose(beside[:3], [0, 0, 1, 0])  # which the detector takes for each other
    tracker.add(
        RigidBody("cup", box(), 0.2),
        BodyBelief(position=beside[:3], **unknown),
        symmetry=[[0, 0, 0, 1], [0, 0, 1, 0]],
    )
    assert tracker.status("cup") is TrackStatus.STARTING
    for k in range(16, 46):
        report = tracker.correct(
            k / RATE, {"box0": measured(RESTING, rng), "cup": measured(ends[k % 2], rng)}
        )
        assert report.rejected == ()
    assert set(report.status.values()) == {TrackStatus.RESTING}
    assert np.linalg.norm(tracker.belief().mean[1, :3] - beside[:3]) < 3e-3
    before, other = tracker.samples()[:, 1], tracker.fork()
    tracker.remove("box0")
    assert len(other.scene.bodies) == 2, "a fork keeps its bodies"
    assert [body.name for body in tracker.scene.bodies] == ["cup"]
    assert np.array_equal(tracker.samples()[:, 0], before)
    tracker.predict(3.0)
    assert tracker.belief().mean[0, 2] == pytest.approx(SIDE / 2, abs=2e-3)


def test_what_lies_on_a_removed_body_falls():
    shelf = load_model("brick")
    top = float(shelf.bounds[1, 2])
    bodies = [RigidBody("box0", box(), 0.3), RigidBody("shelf", shelf, 1.0, fixed=True)]
    scene = Scene.everyday(bodies, exact=True, environment=[Plane(offset=-0.2)])
    belief = belief_of(scene, box0={"position": [0.0, 0.0, top + SIDE / 2]}, shelf=dict.fromkeys(STDS, 0.0))
    tracker = Tracker(scene, belief)
    tracker.predict(2.0)
    assert tracker.belief().mean[0, 2] == pytest.approx(top + SIDE / 2, abs=2e-3)
    tracker.remove("shelf")
    tracker.predict(3.0)
    assert tracker.belief().mean[0, 2] == pytest.approx(-0.2 + SIDE / 2, abs=2e-3)


def test_a_path_changes_at_run_time():
    brick = load_model("brick")  # its front comes to x = 0
    far, near = ([x - float(brick.bounds[1, 0]), 0.0, SIDE / 2] for x in (-0.2, 0.0))
    finger = RigidBody("finger", brick, trajectory=PosePath(times=[0.0, 9.0], positions=[far, far]))
    scene = Scene.everyday(
        [finger, RigidBody("box0", box(), 0.3)], exact=True, environment=[Plane()], friction=0.3
    )
    tracker = Tracker(scene, belief_of(scene, box0={"position": RESTING[:3]}))
    tracker.predict(1.0)
    assert tracker.belief().mean[1, 0] == pytest.approx(0.0, abs=2e-3)
    pushing = PosePath(times=[1.0, 2.0], positions=[far, near])
    tracker.act({"finger": pushing})
    tracker.predict(3.0)
    found = tracker.belief()
    assert found.mean[0, 0] == pytest.approx(near[0], abs=1e-6)
    assert found.mean[1, 0] == pytest.approx(SIDE / 2, abs=0.01)
    with pytest.raises(UncPhysicsError, match="prescribed"):
        tracker.act({"box0": pushing})


@pytest.mark.parametrize(
    ("physics", "positions_alone"),
    [({"integrator": "explicit"}, False), ({"overlap": "keep"}, False), ({}, True)],
)
def test_other_physics_and_positions_are_tracked_too(physics, positions_alone):
    physics = {"integrator": "implicit", "gravity": (0.0, 0.0, -9.81), "dt": 1.0 / 240.0} | physics
    scene = Scene([RigidBody("box0", box(), 0.3)], **physics)
    rng, times = np.random.default_rng(15), np.arange(12) / RATE
    spin = np.zeros(3) if positions_alone else np.array([1.0, 2.0, 0.0])
    truth = flight([0.0, 0.0, 1.0], [0.5, 0.0, 1.0], spin, times)
    known = {**UNKNOWN, "position": truth[0, :3]}
    known |= {"orientation_std": 0.1, "angular_velocity_std": 1.0} if positions_alone else {}
    tracker = Tracker(scene, belief_of(scene, box0=known))
    for time, x in zip(times, truth, strict=True):
        seen = measured(x, rng)
        report = tracker.correct(
            time, {"box0": PositionMeasurement(seen.pose[:3], NOISE[:3]) if positions_alone else seen}
        )
    assert report.status["box0"] is TrackStatus.TRACKED
    (found,) = tracker.belief().mean
    assert np.linalg.norm(found[:3] - truth[-1, :3]) < 5e-3
    assert found[3:6] == pytest.approx([0.5, 0.0, 1.0 - 9.81 * times[-1]], abs=0.06)
    assert np.linalg.norm(found[10:] - spin) < (1.0 if positions_alone else 0.5)


def test_friction_is_learned():
    scene = table_scene(friction=0.4, friction_std=0.15)
    truth_scene = table_scene(friction=0.25)
    start = np.array([state(RESTING[:3], [1.2, 0.0, 0.0])])
    times = np.arange(1, 16) / RATE
    truth, rng = simulated(truth_scene, start, times), np.random.default_rng(13)
    known = {"position": RESTING[:3], "linear_velocity": [1.2, 0.0, 0.0]}
    quiet = ContactNoise(velocity=0.01, rotation=1.0)
    tracker = Tracker(scene, belief_of(scene, box0=known), noise=quiet)
    for time, x in zip(times, truth, strict=True):
        tracker.correct(time, {"box0": measured(x[0], rng)})
    found = tracker.parameters()
    means, stds = zip(*(found[f"friction of {name}"] for name in ("box0", "table")), strict=True)
    # the contact has the geometric mean of two surfaces, each with sqrt(2) times the scene's error
    assert 0.4 * np.exp(np.mean(means) * np.sqrt(2.0) * 0.15 / 0.4) == pytest.approx(0.25, abs=0.05)
    assert max(stds) < 0.9  # 1 before; 0.71 where the mean is known


def test_parameters_are_named_as_their_bodies_and_elements():
    light, other = (RigidBody(name, box(), 0.3, mass_std=0.05) for name in ("light", "other"))
    table = Plane(offset=0.0, friction=0.4, friction_std=0.1, surface_tilt_std=0.01, name="table")
    scene = Scene.everyday([light, other], exact=True, environment=[table], gravity_direction_std=0.01)
    known = {"light": {"position": [0.0, 0.0, 0.3]}, "other": {"position": [0.0, 0.0, 0.6]}}
    found = Tracker(scene, belief_of(scene, **known)).parameters()
    assert list(found) == [
        "gravity_direction[0]",
        "gravity_direction[1]",
        "mass of light",
        "mass of other",
        "friction of table",
        "surface_tilt[0] of table",
        "surface_tilt[1] of table",
    ]
    np.testing.assert_allclose([*found.values()], np.tile([0.0, 1.0], (7, 1)), atol=1e-9)


@pytest.mark.parametrize(
    ("call", "words"),
    [
        (
            lambda t: t.correct(0.1, {"cup": PoseMeasurement(RESTING, NOISE)}),
            "names no moving body of the scene, whose moving bodies are: 'box0'",
        ),
        (lambda t: t.correct(0.1, {"box0": 3.0}), "PoseMeasurement"),
        (lambda t: t.predict(-1.0), "time"),
        (lambda t: t.belief(-1.0), "window"),
        (lambda t: t.ahead(-0.5), r"times\[0\].*-0\.5"),
        (lambda t: t.remove("cup"), "cup"),
        (lambda t: t.correct(0.1, {"box0": RelativePoseMeasurement("box0", RESTING, NOISE)}), "another body"),
        (lambda t: PoseMeasurement(RESTING, -NOISE), "negative"),
        (lambda t: PoseMeasurement(RESTING, NOISE, origin="corner"), "origin"),
        (lambda t: ContactNoise(velocity=-1.0), "velocity"),
        (lambda t: Tracker(t.scene, t.belief(), members=2), "members"),
        (lambda t: Tracker(t.scene, t.belief(), symmetries={"cup": [[0, 0, 0, 1]]}), "cup"),
        *[
            (call, words)
            for given, got in (("x", "'x'"), ([0, 0, 0, 1], r"\[0, 0, 0, 1\]"))
            for call, words in (
                (
                    lambda t, given=given: Tracker(t.scene, t.belief(), symmetries={"box0": given}),
                    rf"symmetries\['box0'\] must be an AxialSymmetry, or quaternions .*got .*{got}",
                ),
                (
                    lambda t, given=given: t.add(RigidBody("b", box(), 0.3), BodyBelief(), given),
                    f"^symmetry must be an AxialSymmetry, or quaternions .*got .*{got}",
                ),
            )
        ],
        (lambda t: Tracker(t.scene, t.belief(), symmetries=[]), "symmetries must be a Mapping"),
        (
            lambda t: t.status("nope"),
            r"^name names no moving body of the scene, whose moving bodies are: 'box0' \(got 'nope'\)",
        ),
        (lambda t: AxialSymmetry([0.0, 0.0, 0.0]), "axis"),
        (
            lambda t: t.add(RigidBody("b", box(), 0.3, mass_std=0.1), BodyBelief()),
            "body must have no uncertain parameters when it is added",
        ),
        (
            lambda t: t.add(RigidBody("b", box(), 0.3, center_of_mass_std=0.01), BodyBelief()),
            "center_of_mass cannot be uncertain in a tracker",
        ),
        (
            lambda t: Tracker(replace(t.scene, overlap="reject"), t.belief()),
            r"overlap must be 'project' or 'keep' in a tracker \(got 'reject'\)",
        ),
        (
            lambda t: Tracker(
                replace(t.scene, bodies=[*bodies(1), RigidBody("b", box(), 1.0, mass_std=0.1)]),
                belief_of(table_scene(2), box0={}, box1={"position": (1, 0, 1)}),
            ).remove("b"),
            "body 'b' must have no uncertain parameters to be removed",
        ),
        *(
            (lambda t, name=name: t.act({name: AHEAD}), f"paths is no prescribed body of the scene.*'{name}'")
            for name in ("box0", "table")
        ),
        (lambda t: t.correct(0.1, {"box0": RelativePoseMeasurement("cup", RESTING, NOISE)}), "another body"),
    ],
)
def test_bad_input_names_field_and_value(call, words):
    scene = table_scene()
    tracker = Tracker(scene, belief_of(scene, box0={"position": RESTING[:3]}))
    with pytest.raises(UncPhysicsError, match=words):
        call(tracker)


def test_a_prediction_does_not_blame_the_first_belief():
    scene = table_scene()
    deep = {"box0": {"position": [0.0, 0.0, -0.2], "orientation_std": 0.3}}
    tracker = Tracker(scene, belief_of(scene, **deep))
    assert tracker.ahead([0.1])["box0"].status().flags & Status.INITIAL_OVERLAP
    rng = np.random.default_rng(18)
    moved = pose([0.4, 0.0, SIDE / 2])
    for k in range(1, 61):
        tracker.correct(k / RATE, {"box0": measured(moved, rng)})
    prediction = tracker.ahead([0.1])
    assert not prediction["box0"].status().flags & Status.INITIAL_OVERLAP
    # what the filter of an unknown velocity adds to the energy is no error of steps
    spinning = UNKNOWN | {"position": RESTING[:3], "position_std": 0.002, "orientation_std": 0.02}
    first = Tracker(scene, belief_of(scene, box0=spinning)).ahead([2.0])
    assert not first["box0"].status().flags & Status.NOT_CONVERGED
    assert prediction["box0"].position == pytest.approx(moved[:3], abs=3e-3)


CAN = Rotation.from_rotvec([0.0, 0.5 * np.pi, 0.0])  # lies, its axis along x


def test_a_can_is_followed_whatever_its_angle_about_its_axis():
    can = load_model("can")
    radius = float(can.bounds[1, 0])
    scene = Scene.everyday([RigidBody("can", can, 0.3)], exact=True, environment=[Plane(name="table")])
    lying = {"position": [0.0, 0.0, radius], "orientation": CAN.as_quat(), "orientation_std": 0.02}
    rng, errors, spins = np.random.default_rng(19), [], []
    tracker = Tracker(
        scene,
        belief_of(scene, can={**lying, "linear_velocity_std": 0.5, "angular_velocity_std": 5.0}),
        symmetries={"can": AxialSymmetry(reversible=True)},
    )
    over = Rotation.from_rotvec([np.pi, 0.0, 0.0])
    for k in range(1, 31):  # it rolls: the detector returns any angle about the axis, and either end
        roll = Rotation.from_rotvec([0.0, 0.0, rng.uniform(-np.pi, np.pi)])
        seen = CAN * roll * (over if rng.random() < 0.5 else Rotation.identity())
        report = tracker.correct(
            k / RATE, {"can": measured(pose([0.0, 0.3 * k / RATE, radius], seen.as_quat()), rng)}
        )
        assert report.rejected == ()
        axis = Rotation.from_quat(tracker.belief().mean[0, 6:10]).apply([0.0, 0.0, 1.0])
        errors.append(np.arccos(min(abs(axis[0]), 1.0)))
        spins.append(tracker.belief().mean[0, 10])
    assert max(errors) < 0.06
    assert tracker.belief().mean[0, 4] == pytest.approx(0.3, abs=0.03)
    assert spins[-1] == pytest.approx(-0.3 / radius, rel=0.15)  # contact tells what no pose shows


def test_a_hidden_body_in_clutter_is_where_the_seen_one_pushed_it():
    scene = table_scene(3, friction=0.3)
    row = [0.0, SIDE + 0.05, 2.0 * SIDE + 0.06]  # the middle one is hidden by the others
    start = np.array([state([x, 0.0, SIDE / 2], [1.2 * (k == 0), 0.0, 0.0]) for k, x in enumerate(row)])
    times = np.arange(1, 25) / RATE
    truth, rng = simulated(scene, start, times), np.random.default_rng(22)
    known = {
        f"box{k}": {"position": start[k, :3], "linear_velocity": start[k, 3:6], "linear_velocity_std": 0.1}
        for k in range(3)
    }
    tracker, blind = (Tracker(scene, belief_of(scene, **known)) for _ in range(2))
    for time, x in zip(times, truth, strict=True):
        tracker.correct(time, {f"box{k}": measured(x[k], rng) for k in (0, 2)})
    blind.predict(times[-1])
    assert truth[-1, 1, 0] - row[1] > 0.02
    found, other = tracker.belief(), blind.belief()
    error = found.mean[1, :3] - truth[-1, 1, :3]
    P = found.marginal(1)[:3, :3]
    assert error @ np.linalg.solve(P, error) < 16.3  # 99.9 %
    assert np.sqrt(P[0, 0]) < 0.6 * np.sqrt(other.marginal(1)[0, 0])
    assert tracker.status("box1") in (TrackStatus.COASTING, TrackStatus.RESTING)


def test_bodies_at_rest_touch_what_they_rest_on():
    can = load_model("can")
    foot = -float(can.bounds[0, 2])
    bodies = [RigidBody("can", can, 0.3), RigidBody("lower", box(), 0.3), RigidBody("upper", box(), 0.3)]
    scene = Scene.everyday(bodies, exact=True, environment=[Plane(name="table")])
    known = {
        "can": {"position": [0.4, 0.0, foot]},
        "lower": {"position": RESTING[:3]},
        "upper": {"position": [0.0, 0.0, 1.5 * SIDE]},
    }
    tracker = Tracker(scene, belief_of(scene, **known), time=100.0)
    tracker.predict(102.0)
    for body in scene.bodies:
        assert tracker.status(body.name) is TrackStatus.RESTING
    prediction = tracker.ahead([0.3])
    pairs = (
        (("can", "table"), 1.0),
        (("lower", "table"), 1.0),
        (("lower", "upper"), 1.0),
        (("upper", "table"), 0.0),
        (("can", "lower"), 0.0),
    )
    for names, expected in pairs:
        assert prediction.probability(Touches(*names)).estimate == expected
    for names in (("can", "table"), ("upper", "lower")):
        assert prediction.contact_time(Touches(*names)).mean == pytest.approx(0.0, abs=scene.dt)


# of two that the filter explains the second one decides, as none counts for more than e^14 of the e^25 that
# are needed; after a thirtieth of a second 14 cm are too far even for the filter, whose next pose agrees
@pytest.mark.parametrize(("gap", "rejected"), [(1.0 / RATE, 2), (0.2, 1)])
def test_every_pose_without_an_effect_is_reported_as_rejected(gap, rejected):
    can = load_model("can")
    foot = -float(can.bounds[0, 2])
    scene = Scene.everyday([RigidBody("can", can, 0.3)], exact=True, environment=[Plane(name="table")])
    tracker, rng = (
        Tracker(scene, belief_of(scene, can={"position": [0.0, 0.0, foot]})),
        np.random.default_rng(0),
    )
    for k in range(1, 61):
        tracker.correct(k / RATE, {"can": measured(pose([0.0, 0.0, foot]), rng)})
    without, listed = [], []
    for time in 2.0 + gap + np.arange(8) / RATE:
        unseen = tracker.fork()
        unseen.predict(time)
        report = tracker.correct(time, {"can": measured(pose([0.14, 0.0, foot]), rng)})
        without.append(np.array_equal(tracker.belief().mean, unseen.belief().mean))
        listed.append(report.rejected == ("can",))
    assert listed == without == [True] * rejected + [False] * (8 - rejected)
    assert report.distance["can"] < 5.0
