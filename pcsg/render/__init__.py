"""From rays to pictures: camera, light, film, files.

``pcsg.render(scene)`` makes a picture: the name of this package is also the function's, so the
package can be called.
"""

from __future__ import annotations

import sys
from importlib import import_module
from types import ModuleType
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from pcsg.render.image import Image
    from pcsg.render.job import Job, Progress, render
    from pcsg.render.options import Options

_HOMES = {
    "Image": "pcsg.render.image",
    "Job": "pcsg.render.job",
    "Options": "pcsg.render.options",
    "Progress": "pcsg.render.job",
    "render": "pcsg.render.job",
}

__all__ = ["Image", "Job", "Options", "Progress", "render"]


class _CallablePackage(ModuleType):
    """A package that does what its function `render` does when called."""

    def __call__(self, *args: Any, **kwargs: Any) -> Image:
        function: Any = import_module("pcsg.render.job").render
        image: Image = function(*args, **kwargs)
        return image


sys.modules[__name__].__class__ = _CallablePackage


def __getattr__(name: str) -> Any:
    if name in _HOMES:
        return getattr(import_module(_HOMES[name]), name)
    raise AttributeError(f"module 'pcsg.render' has no attribute '{name}'")
