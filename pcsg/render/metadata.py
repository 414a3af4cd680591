"""What a picture's file says about how it was made, so that it can be made again."""

from __future__ import annotations

import json
from typing import TYPE_CHECKING

from pcsg import __version__
from pcsg.render.tracer import RenderScene

if TYPE_CHECKING:
    from pcsg.render.options import Options


def describe(scene: RenderScene, options: Options) -> dict[str, str]:
    """Return texts by keyword, in Latin-1 as PNG asks for.

    Keywords: ``Software``, ``pcsg:grammar`` (digest of the source), ``pcsg:parameters`` (JSON),
    ``pcsg:size``, ``pcsg:samples``, ``pcsg:seed``, ``pcsg:settings`` (JSON, only if overridden).
    """
    texts = {
        "Software": f"pcsg {__version__}",
        "pcsg:grammar": scene.source_hash,
        "pcsg:parameters": json.dumps(dict(scene.parameters)),
        "pcsg:size": f"{options.size[0]}x{options.size[1]}",
        "pcsg:samples": str(options.samples),
        "pcsg:seed": str(options.seed),
    }
    if options.overrides:
        texts["pcsg:settings"] = json.dumps(
            {kind: dict(values) for kind, values in options.overrides.items()}
        )
    return texts
