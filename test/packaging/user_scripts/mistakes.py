"""What type checkers must find: each line that says so, and no other."""

import unc_physics
from unc_physics import BodyBelief, BoxRegion, Plane, Scene, load_model, load_scene, predict

scene, belief, horizon = load_scene("scene.yaml")
prediction = predict(scene, belief, horizon=2.0)
print(prediction.beleif)  # mistake
print(prediction.belief.means)  # mistake
print(prediction["mug"].postion)  # mistake
prediction.probability("touches")  # mistake
prediction[0.5]  # mistake
prediction.body("mug", origin="com")  # mistake
prediction["mug"].covariance("body")  # mistake
BodyBelief(position=(0, 0, 1), positon_std=0.1)  # mistake
print(unc_physics.Scenes)  # mistake
load_scene(3)  # mistake
predict(scene, belief, horizn=2.0)  # mistake
Plane(normal=object())  # mistake
BoxRegion("bin", size=(1, 1, 1), posiiton=(0, 0, 0))  # mistake
Scene([load_model("can")])  # mistake
