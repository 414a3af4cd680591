import base64
import io
import json

import numpy as np
import pytest
from PIL import Image
from served import open_browser, wait_for

import pcsg
from pcsg.errors import UsageError
from pcsg.render.progressive import picture_within

pytest.importorskip("anywidget", reason="the extra `notebook` is missing")
# Some of its dependencies warn of what is theirs to change.
pytestmark = pytest.mark.filterwarnings("default")

WANT = {"type": "want", "size": [64, 48], "samples": 1, "number": 1}


@pytest.fixture(scope="module")
def scene():
    return pcsg.loads("{n = 2} uscale(n) sphere")


def test_a_scene_shows_itself_as_a_picture(scene):
    picture = Image.open(io.BytesIO(scene._repr_png_()))
    assert picture.size == (400, 300)
    assert len(np.unique(np.asarray(picture).reshape(-1, 3), axis=0)) > 100


def test_a_picture_without_time_is_coarse_but_whole(scene):
    image = picture_within(scene, (160, 120), 0.0)
    assert image.finished.all()


@pytest.fixture
def view(scene, monkeypatch):
    from pcsg.view.notebook import SceneView

    sent = []
    monkeypatch.setattr(SceneView, "send", lambda self, *what, **more: sent.append((what, more)))
    made = pcsg.show(scene, size=(64, 48), samples=1)
    made.sent = sent
    yield made
    made.close()


def test_a_view_answers_as_the_page_is_answered(view):
    view._hear(view, WANT, [])
    frames = lambda: [s for s in view.sent if s[0][0]["type"] == "frame"]  # noqa: E731 -- read twice
    wait_for(lambda: frames() and frames()[-1][0][0]["done"], "the picture")
    (head,), more = frames()[-1]
    depth, data = more["buffers"]
    assert head["number"] == 1
    assert len(depth) == 4 * head["grid"][0] * head["grid"][1]
    assert data.startswith(b"\x89PNG")
    json.dumps(head)
    view._hear(view, {**WANT, "size": [0, 0]}, [])
    assert view.sent[-1][0][0]["type"] == "errors"


@pytest.mark.parametrize("wrong", [{"size": (0, 1)}, {"size": (1,)}, {"samples": 0}, {"mode": "x"}])
def test_wrong_arguments_are_told(scene, wrong):
    with pytest.raises(UsageError):
        pcsg.show(scene, **wrong)
    with pytest.raises(UsageError, match="takes a scene"):
        pcsg.show(None)


DRIVE = """async (script) => {
  const { default: widget } = await import(`data:text/javascript;base64,${script}`);
  const values = { width: 64, height: 48, samples: 1, mode: "" };
  window.sent = [];
  window.hear = null;
  const model = {
    get: (name) => values[name], send: (m) => sent.push(m), on: (_, f) => (hear = f), off() {},
  };
  widget.render({ model, el: document.body });
  return sent.length;
}"""


def test_the_widget_draws_in_a_browser(view):
    from pcsg.view.notebook import bundle

    browser, end = open_browser()
    try:
        page = browser.new_page()
        script = base64.b64encode(bundle().encode()).decode()
        assert page.evaluate(DRIVE, script) == 1
        view._hear(view, page.evaluate("sent[0]"), [])
        wait_for(lambda: any(s[0][0].get("done") for s in view.sent), "the picture")
        (head,), more = next(s for s in view.sent if s[0][0].get("done"))
        parts = [list(part) for part in more["buffers"]]
        page.evaluate(
            "([head, parts]) =>"
            " hear(head, parts.map((p) => new DataView(new Uint8Array(p).buffer)))",
            [head, parts],
        )
        colors = page.evaluate(
            "new Set(document.querySelector('canvas').getContext('2d')"
            ".getImageData(0, 0, 64, 48).data).size"
        )
        assert colors > 20
        page.mouse.move(30, 30)
        page.mouse.down()
        page.mouse.move(60, 30, steps=3)
        page.mouse.up()
        last = page.evaluate("sent.at(-1)")
        assert last["camera"]["eye"] != head["camera"]["eye"]
        assert not last["moving"]
    finally:
        end()


def test_a_notebook_runs():
    nbformat = pytest.importorskip("nbformat")
    nbclient = pytest.importorskip("nbclient")
    pytest.importorskip("ipykernel")
    cells = [
        "import pcsg\nscene = pcsg.loads('sphere')\nscene",
        "pcsg.show(scene, size=(64, 48))",
    ]
    book = nbformat.v4.new_notebook(cells=[nbformat.v4.new_code_cell(c) for c in cells])
    nbclient.NotebookClient(book, timeout=300, kernel_name="python3").execute()
    picture, widget = (cell["outputs"][-1]["data"] for cell in book["cells"])
    assert base64.b64decode(picture["image/png"]).startswith(b"\x89PNG")
    assert "application/vnd.jupyter.widget-view+json" in widget
