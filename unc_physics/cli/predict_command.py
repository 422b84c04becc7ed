"""The command ``predict``: a scene file in, predicted poses with covariance out."""

from __future__ import annotations

import argparse
import json
import math
from dataclasses import asdict
from importlib.util import find_spec
from pathlib import Path

from ..checks.shown import printable
from ..propagators.names import ANYTIME, entries
from .output import check_output, note, writing
from .progress import told_progress

_SHOWN_STATE = 1000.0  # bytes of a body's state as Python's numbers and as text
_ROUNDED = 0.01  # of a horizon, from which on its rounding is worth a note
# a tenth is 3.3 standard errors at 99.9 % confidence
_TELLS = f"a propagator that draws --samples 300 tells, or {ANYTIME} with --option probability_error=0.03"
_UNKNOWN = 20  # probabilities that cannot be told are only counted if they are more


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
        help=f"how uncertainty is propagated, by default {ANYTIME}: one of {', '.join(entries())}",
    )
    parser.add_argument(
        "--samples", type=int, metavar="N", help="number of samples, for a propagator that draws them"
    )
    parser.add_argument("--seed", type=int, metavar="S", help="seed of the draws (default 0)")
    parser.add_argument(
        "--option",
        action="append",
        default=[],
        type=_key_and_value,
        metavar="KEY=VALUE",
        help="an option of the propagator, which the command 'propagators' tells; may be repeated",
    )
    parser.add_argument("--horizon", metavar="T", help="time to predict for [s], instead of the scene file's")
    parser.add_argument(
        "--period", metavar="T", help="also report the states every T seconds on the way there"
    )
    parser.add_argument(
        "--time-limit", metavar="T", help="give up after computing for T seconds; compiling does not count"
    )
    parser.add_argument(
        "--probabilities",
        action="store_true",
        help="also report how probable contacts are, and that bodies are at rest at the end",
    )
    parser.add_argument(
        "--status-rollouts",
        type=int,
        metavar="N",
        help=(
            "check the spread of what rests on a single nominal rollout against N others, or 64 where fewer"
            " leave it open (default 12; 0: do not, and flag what touched something as unchecked)"
        ),
    )
    parser.add_argument(
        "--picture",
        metavar="OUT.png",
        help="also draw the prediction, from the side and from above; OUT.gif moves, with --period",
    )
    parser.add_argument("--models", metavar="DIR", help="folder of the models, instead of the model library")
    parser.add_argument("--json", action="store_true", help="print one JSON object instead of a table")
    parser.add_argument(
        "--samples-out",
        type=int,
        metavar="N",
        help="with --json, also N states of each body that are drawn from the prediction",
    )
    parser.set_defaults(run=run)


def _key_and_value(text):
    key, separator, value = text.partition("=")
    if not separator or not key:
        raise argparse.ArgumentTypeError(f"'{text}' is not of the form KEY=VALUE")
    return key, value


def run(arguments) -> int:
    """Predict, and print the result."""
    from ..checks.errors import InvalidOptionError
    from ..checks.validation import integer
    from ..prediction.status import ROLLOUTS, assess, compared_rollouts
    from ..propagators.registry import PROPAGATORS, names_where, propagator_from_texts
    from ..scene.scene_file import load_scene

    if arguments.picture is not None:
        check_picture(arguments.picture)
    if arguments.samples_out is not None:
        integer(arguments.samples_out, "--samples-out", low=1)
        if not arguments.json:
            raise InvalidOptionError(
                "needs --json, which shows the samples", field="--samples-out", value=arguments.samples_out
            )
    rollouts = ROLLOUTS
    if arguments.status_rollouts is not None:
        rollouts = compared_rollouts(arguments.status_rollouts, "--status-rollouts")
    propagator = propagator_from_texts(
        arguments.propagator, _options(arguments.option), arguments.samples, arguments.seed
    )
    if arguments.samples is not None and "samples" not in PROPAGATORS[propagator.name].options():
        draws = names_where(lambda other: "samples" in other.options(), " or ")
        raise InvalidOptionError(
            f"is for a propagator that draws samples, {draws}; {propagator.name} draws none",
            field="--samples",
            value=arguments.samples,
        )
    scene, belief, horizon = load_scene(arguments.scene, arguments.models)
    horizon = horizon if arguments.horizon is None else arguments.horizon
    prediction = _predict_with_progress(
        scene,
        belief,
        propagator,
        horizon,
        arguments.period,
        arguments.time_limit,
        keep_samples=_shown_samples(arguments.picture),
    )
    _note_what_is_left_out(arguments, scene, propagator, horizon)
    seed = prediction.seed if prediction.seed is not None else arguments.seed
    answers = _answers(prediction) if arguments.probabilities else None
    statuses = assess(prediction, rollouts=rollouts)
    if arguments.json:
        found = (
            {}
            if answers is None
            else {key: [asdict(answer) for answer in own] for key, own in answers.items()}
        )
        result = as_dict(prediction, seed, _samples(prediction, arguments.samples_out))
        print(json.dumps(result | {"statuses": _statuses(statuses)} | found, allow_nan=False))
    else:
        print(as_table(prediction))
        print(statuses_as_text(statuses))
        if answers is not None:
            print(answers_as_table(answers))
    if arguments.picture is not None:
        from .scene_animation import draw_animation
        from .scene_picture import draw_prediction

        draw = draw_animation if Path(arguments.picture).suffix == ".gif" else draw_prediction
        with writing(Path(arguments.picture), "--picture"):
            draw(arguments.picture, prediction, Path(arguments.scene).stem.replace("_", " "))
    return 0


def _options(pairs):
    """Options by their keys."""
    from ..checks.errors import InvalidOptionError

    options = dict(pairs)
    if len(options) < len(pairs):
        keys = [key for key, _ in pairs]
        twice = next(key for key in keys if keys.count(key) > 1)
        raise InvalidOptionError("is given twice", field="--option", value=twice)
    return options


def _samples(prediction, count):
    """Some states that are drawn from the prediction; None where none are wanted."""
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
    """Statuses as plain Python values; a measure without bounds is None."""
    return [
        {
            "body": status.body,
            "flags": [flag.name for flag in status.flags],
            "message": status.message,
            "reasons": list(status.reasons),
            "measures": {
                key: value if math.isfinite(value) else None for key, value in status.measures.items()
            },
        }
        for status in statuses
    ]


def statuses_as_text(statuses) -> str:
    """What speaks against the prediction, a body a line."""
    lines = [
        f"{printable(status.body)}: {' '.join(flag.name for flag in status.flags)}: {status.message}"
        for status in statuses
        if status.flags
    ]
    return "\n".join(lines) if lines else "status: fine"


def _answers(prediction):
    """Probabilities by their names in the JSON."""
    from ..prediction.probabilities import contact_probabilities, rest_probabilities

    return {
        "contact_probabilities": contact_probabilities(prediction),
        "rest_probabilities": rest_probabilities(prediction),
    }


def answers_as_table(answers) -> str:
    """Probabilities as text, one a line; '-' where the propagator cannot tell one, which a last line
    explains.

    Many that it cannot tell are only counted.
    """
    lines = []
    for answer in answers["contact_probabilities"]:
        what = printable(f"{answer.object_a} and {answer.object_b} touch")
        when = ""
        if answer.first_contact_time_available:
            when = (
                f"  first after {answer.first_contact_time_mean:.3f} s, std"
                f" {answer.first_contact_time_std:.3f} s"
            )
        lines.append((what, answer, when))
    lines += [
        (printable(f"{answer.object} is at rest"), answer, "") for answer in answers["rest_probabilities"]
    ]
    unknown = sum(not answer.available for _, answer, _ in lines)
    if unknown > _UNKNOWN:
        lines = [line for line in lines if line[1].available]
    width = max((len(what) for what, *_ in lines), default=0)
    rows = [
        f"{what:<{width}}  {f'{answer.probability:5.3f}' if answer.available else '    -'}{when}"
        for what, answer, when in lines
    ]
    if unknown:
        which = f"{unknown} {'more ' if rows else ''}are" if unknown > _UNKNOWN else "-:"
        rows.append(f"{which} not known to a tenth; {_TELLS}")
    return "\n".join(rows)


def check_picture(path):
    """Refuse a picture that cannot be drawn or written, before any work is done."""
    from ..checks.errors import NotSupportedError

    missing = [name for name in ("matplotlib", "scipy") if find_spec(name) is None]
    if missing:
        raise NotSupportedError(f"--picture needs {' and '.join(missing)}: pip install {' '.join(missing)}")
    check_output(path, ".gif" if Path(path).suffix == ".gif" else ".png", "--picture")


def _note_what_is_left_out(arguments, scene, propagator, horizon):
    """Say what of the arguments has no effect, or another than may be meant."""
    if arguments.seed is not None and not hasattr(propagator, "seed"):
        note(f"--seed {arguments.seed} has no effect, as {propagator.name} draws nothing")
    if horizon is None:
        return
    horizon = float(horizon)
    steps = round(horizon / scene.dt)
    if abs(steps * scene.dt - horizon) > _ROUNDED * horizon:
        note(
            f"the horizon of {horizon:g} s is rounded to {steps} step{'s' * (steps != 1)} of dt ="
            f" {scene.dt:.6g} s, {steps * scene.dt:.6g} s"
        )
    if arguments.period is not None and float(arguments.period) >= horizon:
        note(
            f"--period {float(arguments.period):g} s is not below the horizon of {horizon:g} s, which alone"
            " is reported"
        )


def _shown_samples(picture):
    """How many samples of each time a picture shows."""
    from .scene_animation import GHOSTS

    return GHOSTS if picture is not None and Path(picture).suffix == ".gif" else 0


def _predict_with_progress(scene, belief, propagator, horizon, period, time_limit, keep_samples):
    """Predict; what takes long tells how far it is."""
    from ..checks.errors import InvalidHorizonError, PredictionTimeoutError
    from ..checks.validation import positive
    from ..prediction.predict import periodic_times, predict

    if time_limit is not None:
        time_limit = positive(time_limit, "--time-limit")
    times = None if period is None else periodic_times(period, horizon)
    if times and round(times[0] / scene.dt) < 1:
        raise InvalidHorizonError(
            f"is shorter than half a step of dt = {scene.dt} s", field="period", value=period
        )
    with told_progress(propagator.name, "step", f"a horizon of {horizon} s") as show:
        try:
            return predict(
                scene,
                belief,
                propagator,
                horizon,
                times=times,
                max_computation_time=time_limit,
                progress=show,
                keep_samples=keep_samples,
            )
        except PredictionTimeoutError as error:
            raise PredictionTimeoutError(error.problem, field="--time-limit", value=time_limit) from None


def as_dict(prediction, seed=None, samples=None) -> dict:
    """The prediction as plain Python values, bodies in the scene's order, with samples (N, B, 13) of it.

    Each body's ``start`` is its belief at time 0 that was really used (`Prediction.start`).
    """
    from ..scene.physics_summary import physics_of

    scene = prediction.scene
    result = {
        "propagator": prediction.propagator.name,
        "physics": physics_of(prediction.scene),
        "seed": seed,
        "time": prediction.time,
        "wall_time": prediction.wall_time,
        "bodies": _bodies(scene, prediction.belief),
    }
    starts = _bodies(scene, prediction.start)
    for found, body, start in zip(result["bodies"], scene.bodies, starts, strict=True):
        del start["name"]
        found |= {"at_rest": body.at_rest, "start": start}
    if samples is not None:
        for k, body in enumerate(result["bodies"]):
            body["samples"] = samples[:, k].tolist()
    if len(prediction.times) > 1:
        result["trajectory"] = [
            {"time": time, "bodies": _bodies(scene, belief)}
            for time, belief in zip(prediction.times, prediction.beliefs, strict=True)
        ]
    return result


def _bodies(scene, belief):
    from ..physics.layout import ANGULAR_VELOCITY, POSITION, QUATERNION, VELOCITY

    bodies = []
    for k, body in enumerate(scene.bodies):
        state, P = belief.mean[k], belief.marginal(k)
        bodies.append(
            {
                "name": body.name,
                "position": state[POSITION].tolist(),
                "orientation": state[QUATERNION].tolist(),
                "linear_velocity": state[VELOCITY].tolist(),
                "angular_velocity": state[ANGULAR_VELOCITY].tolist(),
                "covariance": P.tolist() if body.free else None,
            }
        )
    return bodies


def as_table(prediction) -> str:
    """The physics, and the prediction as a table of poses and standard deviations."""
    import numpy as np

    from ..physics.layout import ERR_POSITION, ERR_ROTATION, POSITION, QUATERNION
    from ..scene.physics_summary import physics_as_text

    scene = prediction.scene
    names = [printable(body.name) for body in scene.bodies]
    width = max(4, *map(len, names))
    lines = [f"{prediction.propagator.name}; {physics_as_text(prediction.scene)}"]
    for time, belief in zip(prediction.times, prediction.beliefs, strict=True):
        lines.append(f"t = {time:g} s  ({prediction.propagator.name}, {_duration(prediction.wall_time)})")
        lines.append(
            f"{'body':<{width}}  {'position [m]':^26}  {'orientation (x, y, z, w)':^31}  "
            f"{'std of position [m]':^26}  std of rotation [deg]"
        )
        for k, body in enumerate(scene.bodies):
            state, P = belief.mean[k], belief.marginal(k)
            row = f"{names[k]:<{width}}  {_row(state[POSITION], '8.4f')}  {_row(state[QUATERNION], '7.4f')}  "
            if not body.free:
                row += "fixed" if body.fixed else "prescribed"
            else:
                std = np.sqrt(np.maximum(P.diagonal(), 0.0))
                row += f"{_row(std[ERR_POSITION], '8.4f')}  {_row(np.degrees(std[ERR_ROTATION]), '7.2f')}"
            lines.append(row)
    return "\n".join(lines)


def _duration(seconds):
    return f"{1e3 * seconds:.3g} ms" if seconds < 0.9995 else f"{seconds:.3g} s"


def _row(values, spec):
    return " ".join(f"{value:{spec}}" for value in values)
