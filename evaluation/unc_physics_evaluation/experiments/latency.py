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
    propagators = rows.where(quantity="core").unique("method")
    columns = ("round_trip", "round_trip_p99", "core", "over_core", "spin", "own")
    lines = [
        [label(name), *(number(1e3 * _of(rows, name, column)) for column in columns)] for name in propagators
    ]
    stream = {row["quantity"]: row["value"] for row in rows.where(method="stream")}
    answer, result = (rows.where(method="cancel", quantity=name) for name in ("answer", "result"))
    spin, own = (number(1e3 * _of(rows, "messages", kind)) for kind in ("spin", "own"))
    return (
        "Two objects of 100 spheres that collide, over Fast DDS on one machine; medians of"
        f" {rows[0]['calls']} calls [ms]. Core is the time of the prediction itself, over core what the node"
        " adds. One empty service is on the executor of `rclpy.spin`, the other one on the node's own.\n\n"
        + table(["", "round trip", "p99", "core", "over core", "empty: spin", "own"], lines)
        + f"\n{goal_tables(_figures(results))}\n"
        + f"* A service with the same messages that calculates nothing: {spin} ms (spin), {own} ms (own).\n"
        f"* Ten objects, two in contact, streamed at 30 Hz to the surrogate and four horizons:"
        f" {stream['predicted']:.0f} of {stream['sent']:.0f} predicted, {stream['dropped']:.0f} dropped,"
        f" {number(1e3 * stream['delay'])} ms after their stamp, p99 {number(1e3 * stream['delay_p99'])}.\n"
        f"* A cancelled run of 20 000 samples: answered after {number(1e3 * answer.median())} ms, at most"
        f" {number(1e3 * answer.values().max())}; its result was there after"
        f" {number(1e3 * result.median())} ms, at most {number(1e3 * result.values().max())}.\n"
        f"* From start to ready: {number(_of(rows, 'node', 'start'))} s.\n"
    )


def _figures(results) -> dict[str, list[Figure]]:
    rows = results.rows("latency")
    return {
        "What the node adds, over an empty service's round trip": [
            Figure(
                label(name),
                kind,
                _of(rows, name, "over_core") / _of(rows, name, kind),
                "x",
                goal,
                at_most=True,
            )
            for name in rows.where(quantity="core").unique("method")
            for kind, goal in (("spin", OVER_EMPTY), ("own", None))
        ]
    }


def _of(rows, method, quantity):
    return rows.where(method=method, quantity=quantity).mean()


verdict = goals_met_by(_figures)
