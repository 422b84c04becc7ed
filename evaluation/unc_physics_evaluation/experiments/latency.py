"""Latency of the ROS node: round trips, a stream, cancels and the start, beside empty services."""

from __future__ import annotations

from importlib.util import find_spec

from ..goals import Figure, goal_tables, goals_met_by
from ..jobs import Job, Outcome, Settings
from ..methods import label
from ..results import Results
from ..tables import number, table

TITLE = "Latency of the node"
NEEDS = ("rclpy", "unc_physics_msgs")
OVER_EMPTY = 2.5  # goal: the node's own time over an empty service's round trip


def jobs(settings: Settings) -> list[Job]:
    """One, alone on the machine."""
    calls, seconds = (50, 3.0) if settings.quick else (300, 10.0)
    job = Job("latency", settings.parameters(calls=calls, seconds=seconds), cost=60.0, alone=True)
    return [] if missing(settings) else [job]


def missing(settings: Settings) -> list[str]:
    """What of ROS is not there."""
    absent = [name for name in NEEDS if find_spec(name) is None]
    return (
        [f"latency: {' and '.join(absent)} not found; source ROS 2 and the built interfaces"]
        if absent
        else []
    )


def run(job: Job) -> Outcome:
    """Start the node, and ask it."""
    from ..node_latency import measure

    return Outcome(measure(job.parameters["calls"], job.parameters["seconds"]))


def report(results: Results) -> str:
    """Round trips of each propagator, then the rest."""
    rows = results.rows("latency")
    columns = ("round_trip", "round_trip_p99", "core", "over_core", "spin", "own")
    lines = [
        [label(name), *(number(1e3 * _of(rows, name, column)) for column in columns)]
        for name in rows.where(quantity="core").unique("method")
    ]
    return (
        table(["[ms]", "round trip", "p99", "core", "over core", "empty: spin", "own"], lines)
        + f"\n{goal_tables(_figures(results))}"
    )


def _figures(results) -> dict[str, list[Figure]]:
    rows = results.rows("latency")
    added = [
        Figure(
            label(name), kind, _of(rows, name, "over_core") / _of(rows, name, kind), "x", goal, at_most=True
        )
        for name in rows.where(quantity="core").unique("method")
        for kind, goal in (("spin", OVER_EMPTY), ("own", None))
    ]
    stream = {row["quantity"]: row["value"] for row in rows.where(method="stream")}
    note = f"p99 {number(1e3 * stream['delay_p99'])} ms; {stream['dropped']:.0f} dropped"
    note += f", {stream['predicted']:.0f} of {stream['sent']:.0f} predicted"
    rest = [
        Figure("same messages, nothing calculated", kind, 1e3 * _of(rows, "messages", kind), "ms")
        for kind in ("spin", "own")
    ]
    rest.append(Figure("prediction of a stream", "10 objects, 30 Hz", 1e3 * stream["delay"], "ms", note=note))
    for quantity in ("answer", "result"):
        found = rows.where(method="cancel", quantity=quantity)
        note = f"at most {number(1e3 * found.values().max())} ms"
        rest.append(Figure(f"cancel: {quantity}", "20 000 samples", 1e3 * found.median(), "ms", note=note))
    rest.append(Figure("start to ready", "the node", _of(rows, "node", "start"), "s"))
    return {"What the node adds, over an empty service's round trip": added, "Other times": rest}


def _of(rows, method, quantity):
    return rows.where(method=method, quantity=quantity).mean()


verdict = goals_met_by(_figures)
