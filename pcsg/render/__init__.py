"""From rays to pictures: camera, light, film, files.

``pcsg.render(scene)`` makes a picture: the name of this package is also the function's, so the
package can be called.
"""

from __future__ import annotations

import sys
from importlib import import_module
from inspect import Signature, getdoc, signature
from types import ModuleType
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from pcsg.render.image import Image
    from pcsg.render.job import Job, Progress, render
    from pcsg.render.options import Options

SUMMARY = "pcsg.render(scene) makes a picture; the parts of the package are in its modules."

_HOMES = {
    "Image": "pcsg.render.image",
    "Job": "pcsg.render.job",
    "Options": "pcsg.render.options",
    "Progress": "pcsg.render.job",
    "render": "pcsg.render.job",
}

__all__ = ["Image", "Job", "Options", "Progress", "render"]


def _function() -> Any:
    return import_module("pcsg.render.job").render


class _CallablePackage(ModuleType):
    """A package that is its function `render`: when called, and for ``help(pcsg.render)``."""

    def __call__(self, *args: Any, **kwargs: Any) -> Image:
        image: Image = _function()(*args, **kwargs)
        return image

    @property
    def __doc__(self) -> str:  # type: ignore[override]  # the help is the function's
        function = _function()
        parameters = str(signature(function)).replace("'", "")
        return f"{SUMMARY}\n\nrender{parameters}\n\n{getdoc(function) or ''}"

    @property
    def __signature__(self) -> Signature:
        return signature(_function())


sys.modules[__name__].__class__ = _CallablePackage


def __getattr__(name: str) -> Any:
    if name in _HOMES:
        return getattr(import_module(_HOMES[name]), name)
    raise AttributeError(f"module 'pcsg.render' has no attribute '{name}'")
