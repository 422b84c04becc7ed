"""The page in a real browser without a screen: bodies where they should be, and a time line that works."""

import io
import shutil
import time

import numpy as np
import pytest

from unc_physics import Belief, BodyBelief, Plane, RigidBody, Scene, load_model, make_propagator
from unc_physics.__main__ import main

viser = pytest.importorskip("viser", reason="the extra 'view' is not installed")
playwright = pytest.importorskip("playwright.sync_api", reason="playwright is not installed")
BROWSERS = ("chromium-headless-shell", "chromium", "chromium-browser", "google-chrome")
BROWSER = next(filter(None, map(shutil.which, BROWSERS)), None)
pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(BROWSER is None, reason=f"none of {', '.join(BROWSERS)} is installed"),
]
ON_CPU = ["--no-sandbox", "--use-angle=swiftshader", "--enable-unsafe-swiftshader"]
WIDTH, HEIGHT = 640, 400
PATIENCE = 1800.0  # s, on a busy machine without a GPU
BOX = """
physics: everyday
environment: [{plane: {}}]
bodies: [{name: box, model: salt_box, spheres: 10, position: [0, 0, 0.07], position_std: 0.001}]
"""
OFF = 14  # pixels, between a body's middle and that of what is seen of it


@pytest.fixture(scope="module")
def browser():
    with playwright.sync_playwright() as started:
        browser = started.chromium.launch(executable_path=BROWSER, args=ON_CPU, timeout=1e3 * PATIENCE)
        yield browser
        browser.close()


@pytest.fixture(scope="module")
def shown(browser):
    """A page, what serves it, and what it shows: a box that slides to the right on a floor."""
    from unc_physics.view.page import Page
    from unc_physics.view.session import Session

    box = RigidBody("box", load_model("salt_box").prefix(10), 0.52)
    scene = Scene.everyday([box], exact=True, environment=[Plane(name="floor")])
    start = BodyBelief(position=(0, 0, 0.07), linear_velocity=(1.5, 0, 0), position_std=0.001)
    session = Session(scene, Belief.of(scene, {"box": start}), 0.4, make_propagator("sigma_points"), 9, 2)
    server = Page(session, port=0)
    server._playing.value = False
    page = browser.new_page(viewport={"width": WIDTH, "height": HEIGHT})
    page.set_default_timeout(1e3 * PATIENCE)
    page.goto(f"http://127.0.0.1:{server.port}")
    page.wait_for_selector("canvas")
    yield page, server, session
    page.close()
    server.close()


def picture(page):
    """What is seen, (height, width, 3)."""
    from PIL import Image

    return np.asarray(Image.open(io.BytesIO(page.screenshot())).convert("RGB"), float)


def middle_of_blue(page):
    """Middle of the first body's pixels, to the right and down, as soon as there are any; None without."""
    red, _, blue = np.moveaxis(picture(page)[:, : WIDTH - 320], 2, 0)
    rows, columns = np.nonzero(blue - red > 50.0)
    return np.array([columns.mean(), rows.mean()]) if len(rows) > 20 else None


def expected(server, frame):
    """Where the body's middle is in the picture, by the camera that the browser tells of."""
    camera = next(iter(server.server.get_clients().values())).camera
    R = viser.transforms.SO3(np.array(camera.wxyz)).as_matrix()
    right, down, ahead = R.T @ (server.drawn.frames.positions[frame, 0] - camera.position)
    focal = 0.5 * HEIGHT / np.tan(0.5 * camera.fov)
    return np.array([0.5 * WIDTH + focal * right / ahead, 0.5 * HEIGHT + focal * down / ahead])


def wait_for(condition):
    end = time.monotonic() + PATIENCE
    while time.monotonic() < end:
        value = condition()
        if value is not None and value is not False:
            return value
        time.sleep(0.2)
    raise AssertionError("waited in vain")


def test_the_body_is_where_it_should_be_and_the_time_line_moves_it(shown):
    page, server, _ = shown

    def at(frame):
        seen = middle_of_blue(page)
        return seen is not None and np.linalg.norm(seen - expected(server, frame)) < OFF

    wait_for(lambda: at(0))
    line = page.get_by_role("slider").first
    line.focus()
    line.press("End")
    wait_for(lambda: at(8))
    assert np.linalg.norm(expected(server, 8) - expected(server, 0)) > 3 * OFF
    wait_for(lambda: server.drawn._time.text == "t = 0.40 s")


def test_a_slider_predicts_anew(shown):
    page, _, session = shown
    before = session.prediction["box"].position_std
    slider = page.get_by_role("slider").nth(1)
    slider.focus()
    slider.press("End")  # 20 mm in place of 1
    wait_for(lambda: session.prediction["box"].position_std[0] > 5.0 * before[0])


def test_another_propagator_is_chosen(shown):
    page, _, session = shown
    page.get_by_role("combobox", name="propagator").click()
    page.get_by_role("option", name="monte_carlo").click()
    wait_for(lambda: session.prediction.propagator.name == "monte_carlo")
    wait_for(lambda: "monte" in page.locator("body").inner_text())


def test_a_recorded_page_stands_alone(browser, tmp_path):
    out = tmp_path / "page.html"
    scene = tmp_path / "scene.yaml"
    scene.write_text(BOX)
    assert main(["view", str(scene), "--frames", "4", "--ghosts", "2", "--record", str(out)]) == 0
    page = browser.new_page(viewport={"width": WIDTH // 2, "height": HEIGHT // 2}, offline=True)
    page.set_default_timeout(1e3 * PATIENCE)
    page.goto(f"file://{out}")
    page.wait_for_selector("canvas")
    wait_for(lambda: middle_of_blue(page))
    page.close()
