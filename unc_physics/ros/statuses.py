"""How far each state can be trusted, as messages."""

from __future__ import annotations

from dataclasses import replace

from diagnostic_msgs.msg import KeyValue

from ..prediction.status import assess_all

#: Measures that have fields of their own in the message.
_OF_OVERLAP = ("overlap_share", "overlap_moved", "overlap_kept")
#: States of one object that are judged one by one; the message says so, too.
JUDGED = 16


def write_statuses(message, prediction, rollouts) -> None:
    """Write the status of each object, and of each of its states, into a `Prediction` message.

    Parameters
    ----------
    message : unc_physics_msgs/Prediction
        Its objects and their states are there already.
    prediction : Prediction
    rollouts : int
        With which the spreads of propagators with a single nominal rollout are compared.

    Notes
    -----
    In a trajectory of more than `JUDGED` states so many are judged, evenly spread and the last among them;
    those before one of them share its flags.
    """
    count = len(prediction.times)
    parts = min(count, JUDGED)
    ends = [count * (part + 1) // parts for part in range(parts)]
    judged = replace(
        prediction,
        times=tuple(prediction.times[end - 1] for end in ends),
        beliefs=tuple(prediction.beliefs[end - 1] for end in ends),
    )
    begin = 0
    for end, statuses in zip(ends, assess_all(judged, rollouts=rollouts), strict=True):
        for predicted, status in zip(message.objects, statuses, strict=True):
            for state in predicted.states[begin:end]:
                state.status = int(status.flags)
        begin = end
    for predicted, status in zip(message.objects, statuses, strict=True):  # those of the last time
        predicted.status, predicted.status_msg = int(status.flags), status.message
        predicted.status_values = [
            KeyValue(key=key, value=f"{value:.6g}") for key, value in status.measures.items()
        ]
        for name in _OF_OVERLAP:
            setattr(predicted, name, status.measures.get(name, 0.0))
