"""The node's tracked objects without DDS: births, association, forgetting, and changes of the environment."""

import itertools

import numpy as np
import pytest
from scenes import floor, measured
from shape_msgs.msg import SolidPrimitive

from unc_physics import assess_stability
from unc_physics.checks.errors import InvalidEnvironmentError, InvalidModelError, NotReadyError
from unc_physics.ros.association import Place, assign
from unc_physics.ros.detected import detected_object
from unc_physics.ros.models import ModelLibrary
from unc_physics.ros.node_environment import NodeEnvironment
from unc_physics.ros.parameters import Settings
from unc_physics.ros.tracks import Tracks
from unc_physics_msgs.msg import EnvironmentElement, TrackedObject

STD, START = 0.002, 1_000_000_000_000  # m, ns
SETTINGS = Settings(track=True, exact=True, forget_after=5.0)


def block_at(name, x):
    """The first shape of an object of a planning scene."""
    block = EnvironmentElement(id=f"{name}/0")
    block.primitive = SolidPrimitive(type=SolidPrimitive.BOX, dimensions=[0.1, 0.1, 0.2])
    block.pose.position.x, block.pose.position.z = x, 0.1
    return block


@pytest.fixture
def tracks():
    library, environment = ModelLibrary(), NodeEnvironment()
    environment.set([floor()])
    yield Scenery(Tracks(library, environment), environment, library)
    library.discard()


class Scenery:
    """Tracks, and what is observed."""

    def __init__(self, tracks, environment, library):
        self.tracks, self.environment, self.library = tracks, environment, library

    def see(self, t, *places, named=False, settings=SETTINGS, yaw=0.0, models=None):
        """Observe cans or others, at positions and an angle, after a time; with an id if ``named``."""
        seen = []
        for k, (place, model) in enumerate(zip(places, models or ["can"] * len(places), strict=False)):
            pose = measured(place, STD, q=(0.0, 0.0, np.sin(yaw / 2), np.cos(yaw / 2)))
            seen.append(detected_object(f"{model} {k}", model, pose, self.library, SETTINGS))
        ids = {own.id for own in seen} if named else ()
        return self.tracks.observe(self.stamp(t), seen, ids, settings)

    @staticmethod
    def stamp(t):
        return START + round(1e9 * t)

    def known(self):
        """The tracked objects by id."""
        fork = self.tracks.fork()
        fork.arrive()
        self.tracks.keep(fork)
        return {own.id: own for own in fork.messages()}


def height(own):
    return own.pose.pose.position.z


def test_objects_without_an_id_need_a_second_observation(tracks):
    assert tracks.see(0.0, (0, 0, 0)).births == 0 and not tracks.known()
    assert tracks.see(0.1, (0, 0, 0), (1, 0, 0)).births == 1  # the second one is seen for the first time
    assert list(tracks.known()) == ["can_1"]
    assert tracks.see(2.0, (0, 0, 0), (1, 0, 0)).births == 0  # and again too late
    assert tracks.see(2.1, (0, 0, 0), (1, 0, 0)).births == 1
    assert list(tracks.known()) == ["can_1", "can_2"]


@pytest.mark.parametrize(("named", "known"), [(False, "can_1"), (True, "can 0")])
def test_two_observations_of_an_object_are_one(tracks, named, known):
    """As by two detectors."""
    for k in range(2):
        tracks.see(0.1 * k, (0, 0, 0), named=named)
    for k in range(2, 5):
        outcome = tracks.see(0.1 * k, (0, 0, 0), (0.004, 0, 0), named=named)
        assert outcome.accepted == 1 and outcome.skipped == {"can 1": f"is a second observation of '{known}'"}
    assert list(tracks.known()) == [known]


def test_pairs_are_the_most_likely_ones():
    rng = np.random.default_rng(0)
    for _ in range(30):
        expected, observed = (
            [Place("can", rng.uniform(0, 0.3, 3), np.diag(rng.uniform(1e-4, 1e-2, 3))) for _ in range(4)]
            for _ in range(2)
        )

        def cost(pairs, expected=expected, observed=observed):
            total = 0.0
            for i, j in pairs:
                S = expected[i].covariance + observed[j].covariance
                apart = expected[i].position - observed[j].position
                total += apart @ np.linalg.inv(S) @ apart + np.log(np.linalg.det(S))
            return total

        best = min(cost(enumerate(order)) for order in itertools.permutations(range(4)))
        assert cost(assign(expected, observed, 9.0)) == pytest.approx(best)


def test_pairs_have_one_model_and_are_near():
    P = 1e-4 * np.eye(3)
    here, there = np.zeros(3), np.array([0.5, 0.0, 0.0])
    assert assign([Place("can", here, P)], [Place("mug", here, P), Place("can", there, P)], 0.4) == []
    assert assign([Place("can", here, P)], [Place("mug", here, P), Place("can", there, P)], 0.6) == [(0, 1)]


def test_what_is_not_seen_coasts_and_is_forgotten(tracks):
    for k in range(8):
        t = k / 30
        tracks.see(t, (0, 0, 2.0 - 0.5 * 9.81 * t**2), named=True)
    (seen,) = tracks.known().values()
    tracks.tracks.advance(tracks.stamp(0.55), SETTINGS)
    (own,) = tracks.known().values()
    assert own.status == TrackedObject.STATUS_COASTING and own.last_seen == seen.last_seen
    assert height(own) == pytest.approx(2.0 - 0.5 * 9.81 * 0.55**2, abs=0.02)
    assert own.pose.covariance[14] > 2.0 * seen.pose.covariance[14]
    outcome = tracks.see(0.3, (0, 0, 2.0 - 0.5 * 9.81 * 0.3**2), named=True)  # late, within the window
    assert outcome.accepted == 1
    tracks.tracks.advance(tracks.stamp(0.3 + 4.9), SETTINGS)
    assert len(tracks.known()) == 1
    tracks.tracks.advance(tracks.stamp(0.3 + 5.1), SETTINGS)
    assert not tracks.known()


def test_the_angle_about_an_axis_of_symmetry_does_not_count(tracks):
    settings = Settings(track=True, exact=True, symmetric_models=("can",))
    for k, yaw in enumerate((0.0, 2.0, -1.0, 3.0, 0.5, -2.5, 1.0)):
        t = k / 30
        place = 0, 0, 0.6 - 0.5 * 9.81 * t**2
        tracks.see(t, place, named=True, settings=settings, yaw=yaw)
    (own,) = tracks.known().values()
    assert own.rejections == 0 and own.status == TrackedObject.STATUS_TRACKED
    assert own.twist.twist.linear.z == pytest.approx(-9.81 * t, abs=0.1)


def test_going_on_in_parts_is_the_same_as_at_once(tracks):
    for k in range(8):
        tracks.see(k / 30, (0, 0, 0.6 - 0.5 * 9.81 * (k / 30) ** 2), named=True)
    other = tracks.tracks.fork()
    for t in (0.4, 0.6, 0.9):
        tracks.tracks.advance(tracks.stamp(t), SETTINGS)
        found = tracks.known()
    other.advance(tracks.stamp(0.9), SETTINGS)
    other.arrive()
    assert other.messages() == list(found.values())


def test_what_changes_meanwhile_is_not_undone(tracks):
    tracks.see(0.0, (0, 0, 0), named=True)
    fork = tracks.tracks.fork()
    tracks.tracks.clear()
    tracks.tracks.keep(fork)
    assert not tracks.known()


def test_without_an_environment_nothing_is_tracked(tracks):
    tracks.tracks = Tracks(tracks.library, NodeEnvironment())
    with pytest.raises(InvalidEnvironmentError, match="fall for ever"):
        tracks.see(0.0, (0, 0, 0), named=True)


def test_a_floor_that_vanishes_lets_objects_fall(tracks):
    for k in range(8):
        tracks.see(k / 30, (0, 0, 0), named=True)
    tracks.tracks.advance(tracks.stamp(0.5), SETTINGS)
    assert height(tracks.known()["can 0"]) == pytest.approx(0.0, abs=0.005)
    tracks.environment.set([floor(-5.0)])
    tracks.tracks.advance(tracks.stamp(0.9), SETTINGS)
    # it falls from the newest observation on, which is a window or less ago
    fallen = -height(tracks.known()["can 0"])
    assert 0.5 * 9.81 * 0.4**2 - 0.05 < fallen < 0.5 * 9.81 * 0.7**2


def test_an_obstacle_that_becomes_an_object_is_no_obstacle(tracks):
    tracks.environment.set([floor(), block_at("can 1", 1.0)])
    tracks.see(0.0, (0, 0, 0), named=True)
    assert tracks.see(0.1, (0, 0, 0), (1, 0, 0), named=True).births == 1
    places = {name: (own.pose.pose.position.x, height(own)) for name, own in tracks.known().items()}
    assert places["can 0"] == pytest.approx((0.0, 0.0), abs=0.02)
    assert places["can 1"] == pytest.approx((1.0, 0.0), abs=0.02)
    fork = tracks.tracks.fork()
    assert [element.name for element in fork.scene.environment] == ["floor"]


def test_objects_that_are_new_at_the_same_time_are_all_tracked(tracks):
    """The last one is in the planning scene, too, so that another tracker begins with it."""
    tracks.environment.set([floor(), block_at("can 2", 2.0)])
    tracks.see(0.0, (0, 0, 0), named=True)
    places = (0, 0, 0), (1, 0, 0), (2, 0, 0)
    assert tracks.see(0.1, *places, named=True).births == 2
    assert list(tracks.known()) == tracks.tracks.names == ["can 0", "can 1", "can 2"]
    assert tracks.see(0.2, *places, named=True).accepted == 3


def lose(tracks, name, monkeypatch):
    """Make a model unreadable."""
    shape = tracks.library.shape

    def lost(model, *others):
        if model == name:
            raise InvalidModelError("is lost", field="model")
        return shape(model, *others)

    monkeypatch.setattr(tracks.library, "shape", lost)


def test_an_object_that_is_invalid_in_a_new_environment_is_dropped(tracks, monkeypatch):
    both, models = ((0, 0, 0), (1, 0, 0)), ("can", "plate")
    assert tracks.see(0.0, *both, models=models, named=True).births == 2
    assert tracks.tracks.take_dropped() == {}
    tracks.environment.set([floor(-0.01)])
    lose(tracks, "plate", monkeypatch)
    outcome = tracks.see(0.1, both[0], named=True)
    assert outcome.accepted == 1 and not outcome.skipped
    assert list(tracks.known()) == tracks.tracks.names == ["can 0"]
    dropped = tracks.tracks.take_dropped()
    assert list(dropped) == ["plate 1"] and "is lost" in dropped["plate 1"]
    assert tracks.tracks.take_dropped() == {}
    monkeypatch.undo()
    outcome = tracks.see(0.2, *both, models=models, named=True)
    assert (outcome.accepted, outcome.births) == (2, 1)


def test_without_valid_objects_nothing_is_tracked_until_a_new_one(tracks, monkeypatch):
    tracks.see(0.0, (0, 0, 0), models=["plate"], named=True)
    tracks.environment.set([floor(-0.01)])
    lose(tracks, "plate", monkeypatch)
    tracks.tracks.advance(tracks.stamp(0.5), SETTINGS)
    assert not tracks.known() and not tracks.tracks.names
    assert list(tracks.tracks.take_dropped()) == ["plate 0"]
    assert tracks.see(0.6, (0, 0, 0), named=True).births == 1
    assert list(tracks.known()) == ["can 0"]


def test_after_a_long_gap_objects_begin_anew(tracks):
    tracks.see(0.0, (0, 0, 0), named=True)
    outcome = tracks.see(100.0, (3, 0, 0), named=True)
    assert outcome.births == 1
    (own,) = tracks.known().values()
    assert own.pose.pose.position.x == pytest.approx(3.0, abs=0.01)


def test_more_objects_than_allowed_are_left_out(tracks):
    settings = Settings(track=True, exact=True, max_objects=1)
    outcome = tracks.see(0.0, (0, 0, 0), (1, 0, 0), named=True, settings=settings)
    assert outcome.births == 1 and "at most 1" in outcome.skipped["can 1"]


def test_an_object_that_changes_its_id_stays_one_object(tracks):
    """As after an id switch of a detector: two solids of one model are not in one place."""
    for k in range(10):
        tracks.see(0.1 * k, (0.0, 0.0, 0.0), named=True)
    place = measured((0, 0, 0), STD)
    for k in range(10, 20):
        other = detected_object("other", "can", place, tracks.library, SETTINGS)
        outcome = tracks.tracks.observe(tracks.stamp(0.1 * k), [other], {"other"}, SETTINGS)
        assert "its id has changed" in outcome.skipped["other"] and outcome.accepted == 1
    assert list(tracks.known()) == ["can 0"]


def test_a_call_that_is_interrupted_leaves_the_tracker_as_it_was():
    library, environment = ModelLibrary(), NodeEnvironment()
    environment.set([floor()])
    stopped = []

    def interrupt():
        if stopped:
            raise TimeoutError

    scenery = Scenery(Tracks(library, environment, interrupt), environment, library)
    scenery.see(0.0, (0.0, 0.0, 0.0), named=True)
    scenery.see(0.1, (0.0, 0.0, 0.0), named=True)
    before = scenery.known()["can 0"]
    stopped.append(True)
    with pytest.raises(TimeoutError):
        scenery.see(0.4, (0.0, 0.0, 0.0), named=True)
    stopped.clear()
    after = scenery.known()["can 0"]
    assert after.pose == before.pose and after.last_seen == before.last_seen
    library.discard()


def test_an_object_that_turns_on_the_spot_gives_one_hint(tracks):
    def hints(place, model="can", settings=SETTINGS, turn=3.0):
        """For yaw angles at 10 Hz, at places for times."""
        tracks.tracks.clear()
        found = []
        for k, t in enumerate(np.arange(0.0, 1.0, 0.1).tolist()):
            seen = tracks.see(t, place(t), named=True, settings=settings, yaw=turn * t, models=[model])
            found += [(k, hint) for hint in seen.hints]
        return found

    still = (0.0, 0.0, 0.0)
    symmetric = Settings(track=True, exact=True, symmetric_models=("can:z",))
    assert not hints(lambda t: still, settings=symmetric)
    assert not hints(lambda t: still, turn=1.5)  # less than a quarter turn
    assert not hints(lambda t: (0.5 * t, 0.0, 0.0))  # a hand carries it
    ((k, hint),) = hints(lambda t: still)
    assert k == 6 and "'can 0'" in hint and "symmetric_models: ['can:z']" in hint  # at 1.8 rad
    assert not hints(lambda t: still)  # once
    assert "mug:z" in hints(lambda t: still, "mug")[0][1]


def stability(tracks):
    """What is said of the stability of the can for each possible motion."""
    fork = tracks.tracks.fork()
    fork.arrive()
    return [assess_stability(scene, belief, "can 0") for scene, belief in fork.motions("can 0")]


def test_an_object_that_may_stand_is_stable_before_the_tracker_knows_that_it_rests(tracks):
    tracks.see(0.0, (0, 0, 0), named=True)
    with pytest.raises(NotReadyError, match="^object moves in a way .* STARTING"):
        stability(tracks)
    of_motion = []  # the other end of the interval, as long as little is known
    for k in range(1, 9):
        tracks.see(0.1 * k, (0, 0, 0), named=True)
        standing, *others = stability(tracks)
        assert standing.probability == 1.0 and standing.supports == ("floor",)
        of_motion += [own.probability for own in others]
        resting = tracks.known()["can 0"].status == TrackedObject.STATUS_RESTING
        assert resting == (not others)
    assert resting and of_motion[0] < 0.9 and of_motion[-1] > 0.9


def test_an_object_that_surely_moves_is_not_taken_as_one_that_stands(tracks):
    for k in range(4):  # it slides and would stop after 6 cm
        tracks.see(k / 30, (0.7 * k / 30, 0, 0), named=True)
    (only,) = stability(tracks)
    assert only.probability == 0.0
