"""An event and a status rule, from the documentation's page."""

from example_extensions import code, run

#: Adds the rule to the module that it is written for, and asks for the status of a body at 30 m and at 300 m.
RULE = """
from unc_physics import Belief, BodyBelief, RigidBody, Scene, Status, assess, load_model, predict
from unc_physics.prediction import diagnostics

exec(open("rule_far_away.py").read(), vars(diagnostics))
for x in (30.0, 300.0):
    ball = RigidBody("ball", load_model("pin").prefix(1))
    scene = Scene([ball], gravity=(0.0, 0.0, 0.0), dt=0.01)
    belief = Belief.of(scene, {"ball": BodyBelief(position=(x, 0.0, 0.0), position_std=0.1)})
    (status,) = assess(predict(scene, belief, "linearization", horizon=0.1))
    print(int(status.flags), round(status.measures["distance_from_origin"], 6), status.message)
"""


def printed(folder, name, script):
    """Lines that a script prints beside a file of the page."""
    (folder / name).write_text(code()[name])
    status, output, errors = run("-c", script, folders=[folder], cwd=folder)
    assert status == 0, errors
    return output.splitlines()


def test_an_event_is_a_class(tmp_path):
    script = code()["use_higher_than.py"]
    read, estimate = printed(tmp_path, "higher_than.py", script)
    assert read == "True ball above 1.1 m"
    assert (
        abs(float(estimate) - 0.1587) < 4.0 * (0.1587 * 0.8413 / 1000) ** 0.5
    )  # beyond one standard deviation


def test_a_status_rule_is_a_function(tmp_path):
    near, far = printed(tmp_path, "rule_far_away.py", RULE)
    assert near == "0 30.0 "
    assert far.startswith("2 300.0 is far from the origin; choose a world frame near the scene")
    assert far.endswith("(distance_from_origin 300 m above 100 m)")
