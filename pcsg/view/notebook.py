"""A scene in a notebook: its picture, to be turned and zoomed, by the protocol of the page."""

from __future__ import annotations

import multiprocessing
import re
import weakref
from collections.abc import Mapping
from importlib import resources
from pathlib import Path
from threading import Thread
from typing import Any

from pcsg import arguments
from pcsg.errors import EnvironmentFault, PcsgError, UsageError, missing_extra
from pcsg.scene import Scene
from pcsg.view.inbox import Inbox, Message
from pcsg.view.opening import Limits, Opened, Prepared, describe_error
from pcsg.view.wants import LARGEST_SIDE, MOST_SAMPLES, read_want
from pcsg.view.worker import Picture, Worker

try:
    import anywidget
    import traitlets
except ModuleNotFoundError:
    what = missing_extra("pictures in notebooks need", "anywidget", "notebook")
    raise EnvironmentFault(what) from None

MODULES = ("vectors", "camera", "picture", "hands", "widget")
"""Of the page, each after those that it imports: a widget is one file."""

_IMPORT = re.compile(r"^import .*?;\n", re.MULTILINE)


def bundle() -> str:
    """Return the widget's script: the modules of the page, one after the other."""
    folder = resources.files("pcsg.view") / "page"
    parts = []
    for name in MODULES:
        text = _IMPORT.sub("", (folder / f"{name}.js").read_text("utf-8"))
        parts.append(re.sub(r"^export (?!default)", "", text, flags=re.MULTILINE))
    return "\n".join(parts)


class SceneView(anywidget.AnyWidget):
    """A picture of a scene that follows the mouse: see `show`.

    Attributes
    ----------
    width, height
        In pixels.
    samples
        Most samples per pixel.
    mode
        How light is followed; empty as the scene says.
    """

    _esm = bundle()
    width = traitlets.Int(600).tag(sync=True)
    height = traitlets.Int(450).tag(sync=True)
    samples = traitlets.Int(16).tag(sync=True)
    mode = traitlets.Unicode("").tag(sync=True)

    def __init__(self, scene: Scene, **traits: Any) -> None:
        super().__init__(**traits)
        self._ours, theirs = multiprocessing.Pipe()
        # A thread is enough: the scene is there, in this very process.
        arguments_ = (weakref.ref(self), theirs, scene)
        Thread(target=_serve, args=arguments_, name="pcsg-show", daemon=True).start()
        self.on_msg(self._hear)

    def _hear(self, widget: Any, content: Mapping[str, Any], buffers: Any) -> None:
        try:
            self._ours.send(Message("want", read_want(content)))
        except PcsgError as error:
            self.send({"type": "errors", "errors": describe_error(error)})

    def close(self) -> None:
        """Take the picture away."""
        self._ours.close()
        super().close()


def _serve(widget: weakref.ref[SceneView], connection: Any, scene: Scene) -> None:
    """Make pictures until the widget is closed or gone."""

    def send(said: Any) -> None:
        there = widget()
        if there is None:
            raise BrokenPipeError
        if isinstance(said, Picture):
            there.send(said.head, buffers=[said.depth.tobytes(), said.data])
        else:
            there.send(said)

    worker = Worker(send, Path(), Limits())
    inbox = Inbox(connection, worker.interrupt)
    worker.inbox = inbox
    worker.adopt(Prepared.of(Opened(scene.graph, (), ()), scene))
    while (news := inbox.take()) is not None:
        want, _ = news
        try:
            if want is not None:
                worker.show(want)
        except BrokenPipeError:
            return


def show(
    scene: Scene, size: tuple[int, int] = (600, 450), samples: int = 16, mode: str | None = None
) -> SceneView:
    """Return a picture of a scene for a notebook, to be turned, moved and zoomed.

    Parameters
    ----------
    scene
        What to show.
    size
        Width and height in pixels.
    samples
        Most samples per pixel.
    mode
        How light is followed; None as the scene says.

    Raises
    ------
    UsageError
        An argument is out of range.
    """
    if not isinstance(scene, Scene):
        raise UsageError(f"show() takes a scene, not {arguments.shown(scene)}")
    if len(size) != 2:
        raise UsageError("the size is a pair of whole numbers")
    width, height = (arguments.whole(s, "a side of the size", 1, LARGEST_SIDE) for s in size)
    arguments.whole(samples, "samples", 1, MOST_SAMPLES)
    read_want({"size": [width, height], "mode": mode})
    return SceneView(scene, width=width, height=height, samples=samples, mode=mode or "")
