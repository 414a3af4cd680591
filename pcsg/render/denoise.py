"""Noise taken out of finished pictures by Intel's Open Image Denoise, a trained network."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from pcsg.errors import EnvironmentFault, missing_extra
from pcsg.render.image import Image


def load_denoiser() -> Any:
    """Return the function of the library that takes noise out of a picture.

    Raises
    ------
    EnvironmentFault
        It is not installed, or does not run here.
    """
    try:
        from pyoidn import denoise
    except ImportError:
        raise EnvironmentFault(
            missing_extra("taking noise out needs", "the library pyoidn", "denoise")
        ) from None
    except OSError as error:
        raise EnvironmentFault(f"the library pyoidn does not run here: {error}") from error
    return denoise


def denoised(image: Image) -> Image:
    """Return a picture without its noise.

    Colours and normals of what the pixels' centres show tell noise from detail. Where a picture has
    no sample yet nothing is known; it is left as it is until it is whole.

    Raises
    ------
    EnvironmentFault
        The library is not installed, or has failed.
    """
    denoise = load_denoiser()
    if not image.finished.all():
        return image
    albedo, normal = (np.ascontiguousarray(x) for x in (image.albedo.clip(0, 1), image.normal))
    try:
        rgb = denoise(np.ascontiguousarray(image.rgb), albedo, normal, hdr=True)
    except RuntimeError as error:
        raise EnvironmentFault(f"Open Image Denoise has failed: {error}") from error
    texts = {**image.metadata, "pcsg:denoised": "Open Image Denoise"}
    return replace(image, rgb=rgb, metadata=texts)
