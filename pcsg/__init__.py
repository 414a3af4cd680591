"""pcsg: a language and ray tracer for natural scenes of any complexity.

Names are loaded on first use, so that ``import pcsg`` is instant.
"""

from __future__ import annotations

__version__ = "0.1.0"
