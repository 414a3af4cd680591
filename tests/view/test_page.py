"""The page in a real browser."""

import base64
import io
import json
import sys

import numpy as np
import pytest
from PIL import Image
from served import open_browser, serving, wait_for

from pcsg.graph.settings import ANGLES
from pcsg.render.camera import Camera

pytestmark = pytest.mark.skipif(sys.platform == "win32", reason="processes are told otherwise")
pytest.importorskip("websockets", reason="the extra `view` is missing")

THING = """{n = 2} S
S if(n > 0, 1, 2)
1: S -> color(0.8, 0.3, 0.1) box | {n = n-1} move(1.5, 0, 1.5) uscale(0.6) S
2: S -> color(0.1, 0.3, 0.8) sphere
"""
SMALL_TREE = """{
  "species": "small", "ymax": 6, "trunk_scale": 4.0,
  "curves": {
    "G_h": {"type": "pchip", "points": [[0, 0], [0.3, 0.4], [1, 1]]}
  }
}
"""
ENDLESS = (
    "{n = 40} S\nS if(n > 0, 2, 1)\n1: S -> sphere\n"
    "2: S -> {n = n-1} (uscale(0.9999) S | uscale(0.9998) S)\n"
)


@pytest.fixture(scope="module")
def browser():
    found, end = open_browser()
    yield found
    end()


@pytest.fixture(scope="module")
def served(tmp_path_factory):
    file = tmp_path_factory.mktemp("page") / "thing.pcsg"
    file.write_text(THING)
    with serving(file) as running:
        running.file = file
        yield running


@pytest.fixture
def page(browser, served):
    served.file.write_text(THING)
    context = browser.new_context(viewport={"width": 900, "height": 420})
    opened = context.new_page()
    wrong = []
    opened.on("pageerror", lambda error: wrong.append(str(error)))
    opened.on("console", lambda m: wrong.append(m.text) if m.type == "error" else None)
    opened.goto(served.page)
    reach(opened, "done")
    yield opened
    context.close()
    assert not wrong


def state(page):
    return page.evaluate("document.body.dataset.state")


def reach(page, *states):
    wait_for(lambda: state(page) in states, f"{states}: {page.inner_text('#status')}")


def frames(page):
    return int(page.evaluate("document.body.dataset.frames"))


def settle(page, before):
    """Wait for a finished picture that is newer than so many."""
    wait_for(lambda: frames(page) > before and state(page) == "done", "another picture")


def pixels(page):
    data = page.evaluate("document.getElementById('picture').toDataURL()")
    picture = Image.open(io.BytesIO(base64.b64decode(data.partition(",")[2])))
    return np.asarray(picture.convert("RGB")).astype(int)


def drag(page, x, y):
    box = page.locator("#picture").bounding_box()
    middle = box["x"] + box["width"] / 2, box["y"] + box["height"] / 2
    page.mouse.move(*middle)
    page.mouse.down()
    page.mouse.move(middle[0] + x, middle[1] + y, steps=4)
    page.mouse.up()


def test_the_picture_is_there_and_dragging_turns_it(page, served):
    first = pixels(page)
    assert len(np.unique(first.reshape(-1, 3), axis=0)) > 100
    assert served.token not in page.url
    before = frames(page)
    drag(page, 80, 20)
    settle(page, before)
    turned = pixels(page)
    assert np.abs(turned - first).mean() > 3
    before = frames(page)
    page.click("#reset")
    settle(page, before)
    assert np.array_equal(pixels(page), first)


def test_a_reload_keeps_camera_and_values_and_a_second_window_has_its_own(page, served, browser):
    own = pixels(page)
    before = frames(page)
    page.keyboard.press("Tab")
    page.locator("#picture").focus()
    page.keyboard.press("ArrowLeft")
    page.keyboard.press("ArrowLeft")
    settle(page, before)
    wait_for(lambda: not np.array_equal(pixels(page), own), "a turned picture")
    reach(page, "done")
    turned = pixels(page)
    page.reload()
    reach(page, "done")
    assert np.array_equal(pixels(page), turned)
    other = browser.new_context(viewport={"width": 900, "height": 420}).new_page()
    other.goto(served.page)
    reach(other, "done")
    assert np.array_equal(pixels(other), own)
    other.context.close()


def test_a_slider_changes_the_picture_and_the_command_tells_it(page):
    first, before = pixels(page), frames(page)
    page.fill("#value-n", "0")
    page.locator("#value-n").press("Enter")
    settle(page, before)
    assert np.abs(pixels(page) - first).mean() > 3
    page.context.grant_permissions(["clipboard-read", "clipboard-write"])
    page.click("#copy")
    wait_for(lambda: "copied" in page.inner_text("#status"), "the copy")
    text = page.evaluate("navigator.clipboard.readText()")
    assert "pcsg render" in text and "-D n=0" in text and "--size" in text


def test_zooming_goes_to_what_is_under_the_pointer(page):
    box = page.locator("#picture").bounding_box()
    place = box["x"] + box["width"] * 0.45, box["y"] + box["height"] * 0.6
    page.mouse.click(*place)
    wait_for(lambda: "derived" in page.inner_text("#answers"), "the derivation")
    facts = page.inner_text("#answers")
    assert "thing.pcsg:3" in facts and "axiom > S:1" in facts
    first = position(page)
    before = frames(page)
    page.mouse.move(*place)
    for _ in range(12):
        page.mouse.wheel(0, -300)
        page.wait_for_timeout(60)
    page.wait_for_timeout(300)
    settle(page, before)
    page.mouse.click(*place)
    wait_for(lambda: position(page) != first, "another answer")
    assert np.abs(np.array(position(page)) - first).max() < 0.05


def position(page):
    rows = page.locator("#answers dl").inner_text()
    return [float(x.strip(",")) for x in rows.split("position")[1].split("normal")[0].split()]


def test_a_broken_save_shows_all_errors_and_keeps_the_picture(page, served):
    first = pixels(page)
    served.file.write_text("{n = 2} sphera | boxx\n")
    reach(page, "errors")
    shown = page.inner_text("#errors")
    assert "unknown primitive `sphera`" in shown and "unknown primitive `boxx`" in shown
    assert "^^^^^^" in shown and "did you mean" in shown
    assert np.array_equal(pixels(page), first)
    # The last good scene can still be turned.
    before = frames(page)
    drag(page, 60, 0)
    wait_for(lambda: frames(page) > before, "a picture")
    page.click("#errors button")
    assert page.locator("#text-pane textarea").is_visible()
    assert page.locator(".gutter .error").count() == 1
    page.fill("#text-pane textarea", "{n = 2} sphere\n")
    page.keyboard.press("Control+s")
    wait_for(lambda: served.file.read_text() == "{n = 2} sphere\n", "the file")
    reach(page, "done")
    assert page.locator("#errors").is_hidden()


def test_what_was_changed_elsewhere_is_not_lost(page, served):
    page.click("#toggle-text")
    page.fill("#text-pane textarea", THING + "// mine\n")
    served.file.write_text(THING + "// theirs\n")
    wait_for(lambda: "changed elsewhere" in page.inner_text(".text-state"), "a word about it")
    assert "mine" in page.input_value("#text-pane textarea")
    page.click("text=Take the file's text")
    assert "theirs" in page.input_value("#text-pane textarea")


def test_an_endless_grammar_leaves_the_page_alive(page, served):
    before = set(served.children())
    served.file.write_text(ENDLESS)
    reach(page, "preparing", "drawing")
    page.wait_for_timeout(1500)
    assert page.locator("#help-open").is_enabled()
    served.file.write_text("sphere\n")
    reach(page, "done")
    assert len(served.children()) <= len(before) + 1  # one may wait
    served.file.write_text(ENDLESS)
    page.wait_for_timeout(1200)
    wait_for(lambda: page.locator("#stop").is_enabled(), "the button")
    page.click("#stop")
    wait_for(lambda: "stopped" in page.inner_text("#errors"), "a word about it")


def test_a_removed_file_is_told_and_comes_back(page, served):
    served.file.unlink()
    wait_for(lambda: "no such file" in page.inner_text("#errors"), "a word about it")
    served.file.write_text("box\n")
    reach(page, "done")


def test_a_wrong_token_is_told(browser, served):
    context = browser.new_context()
    page = context.new_page()
    page.goto(f"{served.address}/#token=wrong")
    wait_for(lambda: "token" in page.inner_text("#status"), "a word about it")
    context.close()


def test_layers_are_shown_and_narrow_dark_windows_fit(page):
    first, before = pixels(page), frames(page)
    page.select_option("#layer", "normal")
    settle(page, before)
    assert np.abs(pixels(page) - first).mean() > 10
    page.emulate_media(color_scheme="dark")
    page.set_viewport_size({"width": 360, "height": 640})
    assert page.evaluate("document.documentElement.scrollWidth") <= 360
    assert page.evaluate("getComputedStyle(document.body).backgroundColor") == "rgb(21, 24, 20)"


@pytest.mark.parametrize("projection", sorted(ANGLES))
def test_the_page_sends_rays_where_the_renderer_does(page, projection):
    camera = Camera((1.0, 2.0, 3.0), (0.0, 0.5, 1.0), fov=30.0, projection=projection)
    sent = {key: getattr(camera, key) for key in ("eye", "target", "up", "fov", "projection")}
    found = page.evaluate(
        "async (camera) => (await import('/vectors.js')).ray(camera, [0.3, 0.6], 1.5)", sent
    )
    origins, directions = camera.rays(np.array([0.45]), np.array([0.6]), (1.5, 1.0))
    assert np.allclose(found["origin"], origins[0], rtol=0, atol=1e-12)
    assert np.allclose(found["direction"], directions[0], rtol=0, atol=1e-12)


def test_a_sheet_shows_values_and_a_click_takes_one(page):
    first = pixels(page)
    page.click("#open-sheet")
    wait_for(lambda: page.locator("#tiles img").count() == 11, "all tiles")
    before = frames(page)
    page.click("#tiles button:has-text('n = 0')")
    settle(page, before)
    assert np.abs(pixels(page) - first).mean() > 3
    assert page.input_value("#value-n") == "0"


@pytest.fixture
def tree(browser, tmp_path):
    file = tmp_path / "small.json"
    file.write_text(SMALL_TREE)
    with serving(file, "-D", "t=2.6") as running:
        opened = browser.new_context(viewport={"width": 900, "height": 420}).new_page()
        opened.goto(running.page)
        reach(opened, "done")
        yield opened, file
        opened.context.close()


def test_the_timeline_plays_and_curves_are_dragged_by_hand(tree):
    page, file = tree
    age = float(page.input_value("#value-t"))
    before = frames(page)
    page.click("text=Play")
    wait_for(lambda: frames(page) > before + 2, "pictures")
    page.click("text=Pause")
    assert float(page.input_value("#value-t")) != age
    settle(page, before + 2)
    first = pixels(page)
    page.locator(".plot").scroll_into_view_if_needed()
    point = page.locator(".plot circle").last.bounding_box()
    page.mouse.move(point["x"] + 5, point["y"] + 5)
    page.mouse.down()
    page.mouse.move(point["x"] + 5, point["y"] + 60, steps=5)
    page.mouse.up()
    wait_for(lambda: np.abs(pixels(page) - first).mean() > 0.2, "another tree")
    assert file.read_text() == SMALL_TREE
    reach(page, "done")
    page.wait_for_timeout(500)
    high = float(page.locator(".plot circle").last.get_attribute("aria-valuenow"))
    assert high < 0.9  # what was dragged stays, though it is not saved
    page.click("#curves >> text=Save >> nth=0")
    wait_for(lambda: file.read_text() != SMALL_TREE, "the file")
    saved = json.loads(file.read_text())
    assert saved["ymax"] == 6
    assert saved["curves"]["G_h"]["points"][-1][1] < 0.9
    page.click("text=Undo")
    wait_for(lambda: page.input_value("#text-pane textarea") == SMALL_TREE, "the text")
