"""A sheet of small pictures: one parameter at several values."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace

from pcsg.errors import PcsgError
from pcsg.render.image import Image
from pcsg.render.options import Options
from pcsg.render.progressive import Progressive
from pcsg.trace.rays import Stopped
from pcsg.view.opening import Limits, Opened, Prepared
from pcsg.view.wants import SheetWant

SAMPLES = 1


def make_tiles(
    opened: Opened, sheet: SheetWant, limits: Limits, superseded: Callable[[], bool]
) -> Iterator[Image | str]:
    """Yield the picture for every value, or what is wrong with it; ends when something is newer.

    Parameters
    ----------
    opened
        The grammar.
    sheet
        Which parameter and values, and what else is wanted.
    superseded
        Returns whether something newer is wanted.
    """
    for value in sheet.steps:
        if superseded():
            return
        want = replace(sheet.want, values={**sheet.want.values, sheet.name: value})
        try:
            prepared = Prepared.make(opened, want.values, limits, want.size)
            stage = prepared.stage_for(want)
            maker = Progressive(prepared.scene, stage, {}, superseded, limits.threads)
            job = maker.refine(Options(want.size, SAMPLES), lambda frame: None)
        except Stopped:
            return
        except (PcsgError, MemoryError, ArithmeticError) as error:
            yield str(error) or "it does not fit into memory"
        else:
            yield job.image()
