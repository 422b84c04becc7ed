"""The node with a lifecycle."""

import contextlib

from lifecycle_msgs.msg import State, Transition
from lifecycle_msgs.srv import ChangeState, GetState
from running import NodeProcess, result_of, wait_until
from scenes import assert_answered, good_request

from unc_physics.checks.errors import ErrorCode
from unc_physics_msgs.srv import Predict, Reset


class LifecycleProcess(NodeProcess):
    """Ready as soon as its state can be asked for."""

    def __init__(self, **parameters):
        super().__init__(module="unc_physics.ros.lifecycle_node", name="cycle", **parameters)

    def _read(self):
        self._ready.set()
        super()._read()


def test_the_node_goes_through_its_life(client):
    def change(transition):
        request = ChangeState.Request(transition=Transition(id=transition))
        return client.call(ChangeState, "/cycle/change_state", request, timeout=200.0).success

    def state():
        return client.call(GetState, "/cycle/get_state", GetState.Request()).current_state.id

    with LifecycleProcess(track=True, observed_objects=["can"]) as process:
        assert state() == State.PRIMARY_STATE_UNCONFIGURED
        assert not change(Transition.TRANSITION_ACTIVATE)  # which fails, and is answered
        assert change(Transition.TRANSITION_CONFIGURE)
        assert state() == State.PRIMARY_STATE_INACTIVE
        service = client.node.create_client(Predict, "/cycle/predict")
        assert not service.wait_for_service(0.5)
        for _ in range(2):
            assert change(Transition.TRANSITION_ACTIVATE)
            assert_answered(client.predict(good_request(), node="cycle"))
            assert not client.call(Reset, "/cycle/reset", Reset.Request()).result.error_code
            assert change(Transition.TRANSITION_DEACTIVATE)
            wait_until(lambda: not service.service_is_ready())  # or the next request would go to the old one
        assert change(Transition.TRANSITION_CLEANUP)
        assert state() == State.PRIMARY_STATE_UNCONFIGURED
        assert change(Transition.TRANSITION_CONFIGURE)

        def ended():
            """The result of a request that runs when the node is deactivated."""
            assert change(Transition.TRANSITION_ACTIVATE)
            endless = good_request(propagator="monte_carlo", samples=5000, horizon=50.0)
            waiting = client.start(Predict, "/cycle/predict", Predict.Request(request=endless))
            assert_answered(client.predict(good_request(), node="cycle"))  # which it takes up after the first
            assert change(Transition.TRANSITION_DEACTIVATE)
            wait_until(lambda: not service.service_is_ready())
            with contextlib.suppress(AssertionError):  # a machine may be too busy to read it in time
                return result_of(waiting, 10.0).result

        result = ended() or ended() or ended()
        assert result.error_code == ErrorCode.CANCELED
        assert "is being deactivated" in result.error_msg
        assert process.end() == 0
        assert "Traceback" not in process.output
