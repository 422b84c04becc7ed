"""The command ``predict``: predict poses with covariance from a scene file."""

from __future__ import annotations

import json
import math
from dataclasses import asdict
from pathlib import Path

from ..checks.shown import printable
from ..propagators.names import ANYTIME, entries
from .arguments import add_options, check_picture, horizon_of, propagator_options, time_limit
from .output import note, progress_display, writing

_SHOWN_STATE = 1000.0  # bytes of a body's state as Python numbers and as text
_REMEDY = f"use {ANYTIME}, or a propagator with --samples 300"
_UNKNOWN = 20  # limit above which unknown probabilities are only counted


def add_predict_command(commands) -> None:
    """Add the parser of ``predict`` to the command line's subparsers."""
    parser = commands.add_parser(
        "predict",
        help="predict the bodies of a scene file",
        description=(
            "Simulate a scene with uncertain bodies and report each body's predicted state and covariance."
        ),
    )
    parser.add_argument("scene", metavar="SCENE.yaml", help="scene file")
    parser.add_argument(
        "--propagator",
        default=ANYTIME,
        metavar="NAME",
        help=f"method that carries the uncertainty (default {ANYTIME}): one of {', '.join(entries())}",
    )
    parser.add_argument(
        "--samples", type=int, metavar="N", help="number of samples, for a propagator that draws them"
    )
    parser.add_argument("--seed", type=int, metavar="S", help="seed of the draws (default 0)")
    add_options(parser, "--option", "--horizon", "--time-limit", "--models", "--json")
    parser.add_argument(
        "--period", metavar="T", help="also report the states every T seconds before the horizon"
    )
    parser.add_argument(
        "--probabilities",
        action="store_true",
        help="also report the probabilities of contacts, and of rest at the horizon",
    )
    parser.add_argument(
        "--event",
        action="append",
        default=[],
        metavar="EVENT",
        help=(
            "also report the probability of an event, such as 'upright: cup' or 'fell_off: {object: cup}';"
            " may be repeated"
        ),
    )
    parser.add_argument(
        "--status-rollouts",
        type=int,
        metavar="N",
        help=(
            "compare the spread of methods with one nominal rollout with N rollouts, and with 24 more if"
            " these are not decisive (default 12; 0: no comparison, and bodies that touched something are"
            " flagged as unchecked)"
        ),
    )
    parser.add_argument(
        "--picture",
        metavar="OUT.png",
        help="also draw the prediction, from the side and from above; OUT.gif is an animation, with --period",
    )
    parser.add_argument(
        "--samples-out", type=int, metavar="N", help="with --json: also print N sampled states of each body"
    )
    parser.set_defaults(run=run)


def run(arguments) -> int:
    """Predict and print the result."""
    from ..prediction.diagnosis import ROLLOUTS, compared_rollouts
    from ..prediction.status import assess
    from ..scene.scene_file import load_scene

    _check_outputs(arguments)
    rollouts = ROLLOUTS
    if arguments.status_rollouts is not None:
        rollouts = compared_rollouts(arguments.status_rollouts, "--status-rollouts")
    propagator = _propagator(arguments)
    scene, belief, horizon = load_scene(arguments.scene, arguments.models)
    horizon = horizon_of(arguments, horizon)
    events = _events(arguments, scene)
    prediction = _predict_with_progress(arguments, scene, belief, propagator, horizon, events)
    _note_ineffective_arguments(arguments, propagator, horizon)
    if prediction.left_out:
        note(
            f"{propagator.name} leaves out {', '.join(prediction.left_out)}; the status says if the spread is"
            " too small for that"
        )
    found = _probabilities(prediction, events)
    statuses = assess(prediction, rollouts=rollouts)
    for status in statuses:
        for text in status.notes:
            note(f"{printable(status.body)} {text}")
    _print(arguments, prediction, statuses, found)
    if arguments.picture is not None:
        _draw(arguments, prediction, [event for event, *_ in found])
    return 0


def _check_outputs(arguments):
    """Raise an error for output options that cannot be fulfilled."""
    from ..checks.errors import InvalidOptionError
    from ..checks.validation import integer

    if arguments.picture is not None:
        check_picture(arguments.picture)
    if arguments.samples_out is not None:
        integer(arguments.samples_out, "--samples-out", low=1)
        if not arguments.json:
            raise InvalidOptionError(
                "needs --json, which shows the samples", field="--samples-out", value=arguments.samples_out
            )


def _propagator(arguments):
    """Return the propagator with its options."""
    from ..checks.errors import InvalidOptionError
    from ..propagators.registry import PROPAGATORS, names_where, propagator_from_texts

    propagator = propagator_from_texts(
        arguments.propagator, propagator_options(arguments), arguments.samples, arguments.seed
    )
    if arguments.samples is not None and "samples" not in PROPAGATORS[propagator.name].options():
        draws = names_where(lambda other: "samples" in other.options(), "or")
        raise InvalidOptionError(
            f"is for a propagator that draws samples, {draws}; {propagator.name} draws none",
            field="--samples",
            value=arguments.samples,
        )
    return propagator


def _events(arguments, scene):
    """Return the events whose probabilities are reported."""
    from ..prediction.event_entries import event_from_text
    from ..prediction.events import AtRest, encounters, moving_names

    events = [event_from_text(text, "--event") for text in arguments.event]
    for event in events:
        event.check(scene, "--event")
    if arguments.probabilities:
        events += [*encounters(scene), *(AtRest(name) for name in moving_names(scene))]
    return events


def _print(arguments, prediction, statuses, found):
    """Print the prediction with statuses and probabilities, as tables or as JSON."""
    from ..prediction.tables import as_dict, as_text

    if arguments.json:
        seed = prediction.seed if prediction.seed is not None else arguments.seed
        result = as_dict(prediction, seed, _samples(prediction, arguments.samples_out))
        result["statuses"] = _statuses(statuses)
        if found:
            result["probabilities"] = _probabilities_as_dicts(found)
        print(json.dumps(result, allow_nan=False))
        return
    print(as_text(prediction, statuses))
    if found:
        print(probabilities_as_table(found))


def _draw(arguments, prediction, events):
    """Draw a picture, or an animation with the probabilities of events."""
    from ..plots.scene_animation import draw_animation

    def course(event):
        return [prediction.probability(event, time=time).estimate for time in prediction.times]

    title = Path(arguments.scene).stem.replace("_", " ")
    with writing(Path(arguments.picture), "--picture"):
        if Path(arguments.picture).suffix == ".gif":
            draw_animation(
                arguments.picture,
                prediction.scene,
                prediction.times,
                [prediction.start, *prediction.beliefs],
                [snapshot.rollout_states for snapshot in prediction.snapshots],
                {str(event): course(event) for event in events},
                title,
            )
        else:
            prediction.plot(title).savefig(arguments.picture, dpi=110, bbox_inches="tight")


def _samples(prediction, count):
    """Return states drawn from the prediction, or None if not requested."""
    from ..checks.errors import LimitExceededError
    from ..checks.memory import require_memory

    if count is None:
        return None
    bodies = len(prediction.scene.bodies)
    require_memory(count * bodies * _SHOWN_STATE, "what is shown of them", "--samples-out", count)
    try:
        return prediction.samples(count)
    except LimitExceededError as error:
        raise LimitExceededError(error.problem, field="--samples-out", value=error.value) from None


def _statuses(statuses):
    """Return statuses as plain Python values; infinite measures are None."""
    return [
        {
            "body": status.body,
            "flags": [flag.name for flag in status.flags],
            "message": status.message,
            "reasons": list(status.reasons),
            "notes": list(status.notes),
            "measures": {
                key: value if math.isfinite(value) else None for key, value in status.measures.items()
            },
        }
        for status in statuses
    ]


def _probabilities(prediction, events):
    """Return each event, its probability, and the time of the first contact or None."""
    from ..prediction.events import Touches

    return [
        (
            event,
            prediction.probability(event),
            prediction.contact_time(event) if isinstance(event, Touches) else None,
        )
        for event in events
    ]


def _probabilities_as_dicts(found):
    """Return probabilities as plain Python values."""
    return [
        {
            "event": str(event),
            **asdict(probability),
            "first_contact_time_mean": None if time is None else time.mean,
            "first_contact_time_std": None if time is None else time.std,
        }
        for event, probability, time in found
    ]


def probabilities_as_table(found) -> str:
    """Return probabilities with their intervals, one per line; many unknown ones are only counted."""
    unknown = [row for row in found if row[1].low == 0.0 and row[1].high == 1.0]
    rows = found if len(unknown) <= _UNKNOWN else [row for row in found if row not in unknown]
    width = max((len(printable(str(event))) for event, *_ in rows), default=0)
    lines = []
    for event, p, time in rows:
        when = "" if time is None else f"  first after {time.mean:.3f} s"
        when += f", std {time.std:.3f} s" if time is not None and time.std > 0.0 else ""
        lines.append(
            f"{printable(str(event)):<{width}}  {p.estimate:5.3f}  ({p.low:.3f} to {p.high:.3f}){when}"
        )
    if unknown:
        which = f"{len(unknown)} {'more ' if lines else ''}" if len(unknown) > _UNKNOWN else ""
        lines.append(f"{which}(0.000 to 1.000): nothing is known; {_REMEDY}")
    return "\n".join(lines)


def _note_ineffective_arguments(arguments, propagator, horizon):
    """Print notes about arguments without effect or with a possibly unintended effect."""
    if arguments.seed is not None and not hasattr(propagator, "seed"):
        note(f"--seed {arguments.seed} has no effect, as {propagator.name} draws nothing")
    if horizon is None:
        return
    if arguments.period is not None and float(arguments.period) >= horizon:
        note(
            f"--period {float(arguments.period):g} s is not below the horizon of {horizon:g} s, which alone"
            " is reported"
        )


def _predict_with_progress(arguments, scene, belief, propagator, horizon, events):
    """Predict with a progress display."""
    from ..checks.errors import InvalidHorizonError
    from ..checks.validation import number_from_text
    from ..prediction.predict import predict
    from ..prediction.request_checks import periodic_times

    times = None
    if arguments.period is not None:
        period = number_from_text(arguments.period, "period", InvalidHorizonError)
        times = periodic_times(scene, period, horizon)
    waiting = progress_display(propagator.name, "step", f"a horizon of {horizon} s")
    with time_limit(arguments) as limit, waiting as show:
        return predict(
            scene,
            belief,
            propagator,
            horizon,
            times=times,
            max_computation_time=limit,
            progress=show,
            events=events,
        )
