"""Many predictions have the bits of single ones, whoever makes them, and none is lost or doubled."""

import multiprocessing
import os
import queue
import subprocess
import sys
import threading
from concurrent.futures import BrokenExecutor, Executor, Future, ThreadPoolExecutor
from contextlib import closing
from pathlib import Path

import numpy as np
import pytest

from unc_physics import (
    Belief,
    BodyBelief,
    Plane,
    RigidBody,
    Scene,
    Touches,
    make_propagator,
    predict,
    predict_many,
    primitive_model,
)
from unc_physics.checks.errors import DivergedError, InternalError, InvalidRequestError, UncPhysicsError
from unc_physics.prediction import executors, many
from unc_physics.prediction.executors import Workers, in_order
from unc_physics.prediction.status import assess_all

FLOOR = Plane((0, 0, 1), 0.0, name="floor")
SCENE = Scene.everyday(
    [RigidBody("box", primitive_model("box", size=[0.1, 0.1, 0.1]), 1.0)], environment=[FLOOR]
)
EVENTS = [Touches("box", "floor")]
TIMES = [0.05, 0.1]


def belief(k):
    """Over the floor, the higher the larger k."""
    body = BodyBelief(position=[0, 0, 0.06 + 0.002 * k], position_std=0.002, linear_velocity=[0, 0, -0.3])
    return Belief.of(SCENE, {"box": body})


def ask(count, executor=None, propagator="monte_carlo", **options):
    return predict_many(
        (SCENE, belief(0), propagator, TIMES, EVENTS), executor, actions=map(belief, range(count)), **options
    )


def bits(answer):
    assert answer.error is None
    return answer.number, answer.means.tobytes(), answer.covariances.tobytes(), answer.probabilities


class LastFirst(Executor):
    """One thread, which does what was submitted last, and takes note of the sizes of chunks."""

    def __init__(self):
        self.work, self.sizes = queue.LifoQueue(), []
        threading.Thread(target=self.run, daemon=True).start()

    def submit(self, fn, /, *args, **kwargs):
        future = Future()
        self.sizes.append(len(args[1]))
        self.work.put((future, fn, args))
        return future

    def run(self):
        while True:
            self.finish(*self.work.get())

    def finish(self, future, fn, args):
        if future.set_running_or_notify_cancel():
            try:
                future.set_result(fn(*args))
            except executors._Failed as error:
                future.set_exception(error)


class Deadly(LastFirst):
    """Breaks by some items, as a pool does that loses a process, with all that it has to do."""

    made = 0

    def __init__(self, *deadly):
        super().__init__()
        self.deadly, self.broken = set(deadly), False
        Deadly.made += 1

    def submit(self, fn, /, *args, **kwargs):
        if self.broken:
            raise BrokenExecutor("broken before")
        return super().submit(fn, *args, **kwargs)

    def finish(self, future, fn, args):
        self.broken |= bool(self.deadly & set(args[1]))
        if self.broken:
            future.set_exception(BrokenExecutor("killed"))
        else:
            super().finish(future, fn, args)


def doubled(number):
    return 2 * number


def test_answers_have_the_bits_of_single_predictions():
    found = list(ask(3))
    for k, answer in enumerate(found):
        one = predict(SCENE, belief(k), make_propagator("monte_carlo", seed=k), times=TIMES, events=EVENTS)
        assert answer.seed == answer.number == k and answer.bodies == ("box",)
        np.testing.assert_array_equal(answer.times, one.times)
        for at, time in enumerate(TIMES):
            snapshot = one.at(time)
            np.testing.assert_array_equal(answer.means[at], snapshot.belief.mean)
            np.testing.assert_array_equal(answer.covariances[at, 0], snapshot.belief.marginal(0))
            assert answer.probabilities[at] == {"box touches floor": one.probability(EVENTS[0], time=time)}
        assert list(map(repr, answer.statuses)) == list(map(repr, assess_all(one)))
    (own,) = predict_many([(SCENE, belief(1), make_propagator("monte_carlo", seed=7), 0.1)])
    assert own.seed == 7 and own.times.tolist() == [0.1] and own.probabilities == ({},)


def test_an_action_that_cannot_be_done_has_an_answer():
    actions = [belief(0), {"bxo": {"mass": 1.0}}, {"box": {"mass": -1.0}}, belief(3)]
    found = list(predict_many((SCENE, belief(0), "monte_carlo", TIMES, EVENTS), actions=actions))
    assert [answer.number for answer in found] == [0, 1, 2, 3]
    assert [answer.error is None for answer in found] == [True, False, False, True]
    assert str(found[1].error).startswith("actions[1] is neither a body nor")
    assert str(found[2].error) == "actions[2]: mass of body 'box' must be positive (got -1.0)"
    assert bits(found[3]) == bits(list(ask(4))[3])


@pytest.mark.parametrize("wrong", [SCENE, [(SCENE,)], [SCENE]])
def test_requests_that_are_none_are_refused(wrong):
    with pytest.raises(InvalidRequestError, match="a request must be a scene, a belief"):
        list(predict_many(wrong, actions=None if isinstance(wrong, list) else [belief(0)]))


ABANDONED = """
import sys
from test_many import ask
if __name__ == "__main__":
    for answer in ask(400, "processes:1"):
        if sys.argv[1] == "break":
            break
        raise ValueError("mine")
"""


@pytest.mark.parametrize("how", ["break", "raise"])
def test_a_process_that_takes_no_more_answers_ends(tmp_path, how):
    script = tmp_path / "script.py"
    script.write_text(ABANDONED)
    paths = os.pathsep.join([str(Path(__file__).parent), *sys.path])
    done = subprocess.run(
        [sys.executable, str(script), how],
        check=False,
        capture_output=True,
        text=True,
        timeout=600,
        env=os.environ | {"PYTHONPATH": paths},
    )
    said = done.stderr.strip().splitlines()
    assert (said[-1:] == ["ValueError: mine"]) if how == "raise" else not done.returncode, done.stderr
    assert "Exception in thread" not in done.stderr


def test_answers_do_not_depend_on_who_works_and_when():
    expected = [bits(answer) for answer in ask(12)]
    for executor in (LastFirst(), ThreadPoolExecutor(3), LastFirst):
        assert [bits(answer) for answer in ask(12, executor)] == expected


def test_a_killed_process_loses_nothing():
    """The first answers are there when the process is killed, and the pool is made anew."""
    found = ask(40, "processes:1")
    first = next(found)
    for process in multiprocessing.active_children():
        process.kill()
    rest = list(found)
    assert [bits(answer) for answer in (first, *rest)] == [bits(answer) for answer in ask(40)]
    assert not multiprocessing.active_children()


def test_chunks_that_were_lost_are_repeated_and_the_cause_is_found():
    Deadly.made = 0
    with closing(Workers(lambda: Deadly(7))) as workers:
        found = [value for *_, value in sorted(workers.results(doubled, range(20)), key=lambda one: one[0])]
    assert isinstance(found[7], InternalError) and "lost its worker 3 times" in str(found[7])
    assert [value for k, value in enumerate(found) if k != 7] == [2 * k for k in range(20) if k != 7]
    assert Deadly.made == 4
    with pytest.raises(InternalError, match="3 times"), closing(Workers(lambda: Deadly(7))) as workers:
        list(in_order(workers.results(doubled, range(20))))
    with pytest.raises(BrokenExecutor), closing(Workers(Deadly(7))) as workers:
        list(workers.results(doubled, range(20)))


def test_what_the_work_raises_ends_it():
    for executor in (None, LastFirst()):
        with pytest.raises(ZeroDivisionError), closing(Workers(executor)) as workers:
            list(workers.results(lambda number: 1 / number, [1, 0]))


def test_chunks_take_about_the_time_that_is_wanted(monkeypatch):
    monkeypatch.setattr(
        executors, "_run_chunk", lambda f, items, *_: (list(map(f, items)), 0.01 * len(items))
    )
    executor = LastFirst()
    with closing(Workers(executor, chunk_time=0.5)) as workers:
        assert sorted(value for *_, value in workers.results(doubled, range(1000))) == list(range(0, 2000, 2))
    assert executor.sizes[0] == 1 and max(executor.sizes) == 50
    assert len(executor.sizes) < 45


def test_workers_load_kernels_that_this_process_compiled(monkeypatch):
    """Some answers are refused until this process compiles; workers without its folder end the work."""
    compiled, predicted = [], many._answer

    def answer(asked, compiles):
        if compiles and asked.number == 3:
            compiled.append(asked.number)
        refused = asked.number >= 3 and not compiled
        return many._Refused("step", "/cache") if refused else predicted(asked, compiles)

    expected = [bits(one) for one in ask(8)]
    monkeypatch.setattr(many, "_answer", answer)
    assert [bits(one) for one in ask(8, LastFirst())] == expected
    assert compiled == [3]

    def elsewhere(asked, compiles):
        lacks = threading.current_thread() is not threading.main_thread()
        return many._Refused("step", "/cache") if lacks else predicted(asked, compiles)

    monkeypatch.setattr(many, "_answer", elsewhere)
    with pytest.raises(UncPhysicsError, match="a worker has no kernel 'step' in /cache"):
        list(ask(3, LastFirst()))


def test_what_cannot_be_predicted_is_an_answer(monkeypatch):
    def diverges(*arguments, **options):
        raise DivergedError("left the range")

    assert "propagator must be one of" in str(next(ask(1, propagator="none")).error)
    monkeypatch.setattr(many, "predict", diverges)
    found = list(ask(2, LastFirst()))
    assert [str(answer.error) for answer in found] == ["left the range"] * 2


@pytest.mark.parametrize("executor", ["threads:2", "processes:0", 3, lambda: 3])
def test_other_executors_are_refused(executor):
    with pytest.raises(UncPhysicsError, match="executor must be"):
        list(ask(1, executor))


def test_a_dask_cluster_works():
    distributed = pytest.importorskip("distributed")
    options = {"n_workers": 1, "threads_per_worker": 2, "processes": False, "protocol": "tcp://"}
    with distributed.LocalCluster(dashboard_address=None, **options) as cluster:
        address = cluster.scheduler_address.removeprefix("tcp:")
        with distributed.Client(cluster) as client:
            for executor in (f"dask:{address}", client.get_executor()):
                assert [bits(one) for one in ask(6, executor)] == [bits(one) for one in ask(6)]
    soon = pytest.importorskip("dask").config.set({"distributed.comm.timeouts.connect": "100ms"})
    with soon, pytest.raises(UncPhysicsError, match="cannot be reached"):
        list(ask(1, "dask://127.0.0.1:1"))


def table(folder):
    """The rows of a store by number, time and body."""
    found = pytest.importorskip("pyarrow.parquet").read_table(folder)
    return found.sort_by([(name, "ascending") for name in ("number", "time", "body")])


def test_a_store_is_resumed(tmp_path):
    """Its files hold what a run in one piece gives, without what a process left that was killed."""
    pytest.importorskip("pyarrow")
    whole = list(ask(6, store=tmp_path / "whole"))
    folder = tmp_path / "parts"
    begun = ask(6, store=folder)
    next(begun)
    begun.close()
    (folder / "part.tmp").write_text("half of a file")
    rest = list(ask(6, LastFirst(), store=folder))
    assert 0 < len(rest) < 6 and list(ask(6, store=folder)) == []
    assert table(folder).equals(table(tmp_path / "whole"))
    rows = table(folder).to_pylist()
    assert [(row["number"], row["time"], row["body"]) for row in rows] == [
        (k, time, "box") for k in range(6) for time in TIMES
    ]
    last = rows[-1]
    mean, P = whole[5].means[1, 0], whole[5].covariances[1, 0]
    assert last["position"] + last["linear_velocity"] == mean[:6].tolist() and last["seed"] == 5
    assert last["orientation"] + last["angular_velocity"] == mean[6:].tolist()
    assert last["covariance"] == P.ravel().tolist()
    p = whole[5].probabilities[1]["box touches floor"]
    assert last["events"] == [
        {"event": "box touches floor", "estimate": p.estimate, "low": p.low, "high": p.high}
    ]


def test_a_store_refuses_what_does_not_belong_to_it(tmp_path):
    pytest.importorskip("pyarrow")
    running = ask(4, store=tmp_path)
    next(running)
    with pytest.raises(UncPhysicsError, match="in use by another run"):
        next(ask(4, store=tmp_path))
    running.close()
    for other in ({"propagator": make_propagator("monte_carlo", seed=1)}, {"propagator": "cloud"}):
        with pytest.raises(UncPhysicsError, match="another request of number 0"):
            list(ask(4, store=tmp_path, **other))
    (tmp_path / "notes.parquet").write_text("no table")
    with pytest.raises(UncPhysicsError, match="none of its own, notes.parquet"):
        list(ask(4, store=tmp_path))
