"""Pictures in a row: which frames there are, and the files that hold them all.

Frames know nothing of each other. Each is a picture of its own with the texts that describe it, so
any of them may be made by any process, at any time, and one that is there need not be made again.
"""

from __future__ import annotations

import math
import shutil
import subprocess
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import IO, Any

from pcsg.errors import EnvironmentFault, UsageError
from pcsg.inputs import open_bytes
from pcsg.outputs import check_output, write_by_name, write_whole

ENDINGS = (".webp", ".gif", ".png", ".mp4")


@dataclass(frozen=True)
class Range:
    """A value that goes from one number to another over the frames.

    Attributes
    ----------
    whole
        Whether it takes whole numbers only.
    """

    first: float
    last: float
    whole: bool = False

    def at(self, share: float) -> float:
        """Return the value after a share of the frames, from 0 to 1."""
        value = self.first + share * (self.last - self.first)
        return float(round(value)) if self.whole else value


@dataclass(frozen=True)
class Frames:
    """The frames of an animation.

    Attributes
    ----------
    first, last
        Numbers of the first and the last frame.
    per_second
        How many are shown in a second.
    """

    first: int
    last: int
    per_second: float

    @property
    def numbers(self) -> range:
        """The frames' numbers."""
        return range(self.first, self.last + 1)

    def share(self, number: int) -> float:
        """Return 0 for the first frame, 1 for the last."""
        return (number - self.first) / max(self.last - self.first, 1)

    def seconds(self, number: int) -> float:
        """Return when a frame is shown."""
        return (number - self.first) / self.per_second

    def turned(self, number: int) -> float:
        """Return the part of a round, so that the last frame comes just before the first again."""
        return (number - self.first) / (self.last - self.first + 1)


def turn_camera(camera: Mapping[str, Any], degrees: float) -> dict[str, Any]:
    """Return a camera's setting after a walk about its target, on the level."""
    (ex, ey, ez), (tx, ty, _) = camera["eye"], camera["target"]
    angle = math.radians(degrees)
    x, y = ex - tx, ey - ty
    eye = (
        tx + x * math.cos(angle) - y * math.sin(angle),
        ty + x * math.sin(angle) + y * math.cos(angle),
        ez,
    )
    return {**camera, "eye": eye}


def is_pattern(output: Path) -> bool:
    """Return whether an output is one file for each frame: ``frame_####.png``."""
    return "#" in output.name


def frame_path(output: Path, number: int) -> Path:
    """Return where a frame is kept.

    With a pattern, there; else in a folder beside the output until that is written.
    """
    if not is_pattern(output):
        return frames_folder(output) / f"frame_{number:05}.png"
    marks = output.name.count("#")
    name = output.name.replace("#" * marks, f"{number:0{marks}}")
    return output.with_name(name)


def frames_folder(output: Path) -> Path:
    """Return the folder of the frames of a single file."""
    return output.with_name(output.name + ".frames")


def check_animation(output: Path) -> None:
    """Raise an error now if an animation could not be written later.

    Raises
    ------
    UsageError
        The name has no known ending, or marks for numbers in several places.
    EnvironmentFault
        Films need ffmpeg, which is not there.
    """
    if is_pattern(output):
        marks = output.name.count("#")
        if "#" * marks not in output.name or output.suffix.lower() != ".png":
            raise UsageError(
                f"frames are named by one row of # and end in .png, as in frame_####.png: {output}"
            )
    check_output(output, ENDINGS)
    folder = frames_folder(output)
    if not is_pattern(output) and folder.exists():
        check_output(folder / "frame.png", (".png",))
    if output.suffix.lower() == ".mp4" and shutil.which("ffmpeg") is None:
        raise EnvironmentFault(
            "films (.mp4) are made by the program ffmpeg, which is not installed;"
            " .webp, .gif, .png and frame_####.png need nothing"
        )


def texts_of(path: Path) -> dict[str, str] | None:
    """Return the texts in a picture's file; None if it is not there, or damaged."""
    from PIL import Image

    try:
        with open_bytes(path, "frame") as file, Image.open(file, formats=("PNG",)) as picture:
            # What is behind the pixels counts as well, so that half a file is none.
            picture.load()
            return dict(getattr(picture, "text", {}))
    except Exception:  # decoders raise anything when a file is damaged
        return None


def join_frames(output: Path, frames: Sequence[Path], per_second: float) -> None:
    """Write an animation of frames that are pictures in PNG, whole or not at all."""
    if output.suffix.lower() == ".mp4":
        write_by_name(output, lambda place: _write_film(place, frames, per_second))
        return
    write_whole(output, lambda file: _write_animation(file, output, frames, per_second))


def _write_animation(
    file: IO[bytes], output: Path, frames: Sequence[Path], per_second: float
) -> None:
    from PIL import Image

    pictures = [Image.open(path).convert("RGB") for path in frames]
    kind = {".webp": "WEBP", ".gif": "GIF", ".png": "PNG"}[output.suffix.lower()]
    special: dict[str, Any] = {"quality": 88, "method": 6} if kind == "WEBP" else {}
    pictures[0].save(
        file,
        format=kind,
        save_all=True,
        append_images=pictures[1:],
        duration=1000.0 / per_second,
        loop=0,
        **special,
    )


def _write_film(place: Path, frames: Sequence[Path], per_second: float) -> None:
    """Hand the frames to ffmpeg one after the other."""
    command = ["ffmpeg", "-y", "-loglevel", "error"]
    command += ["-f", "image2pipe", "-framerate", str(per_second), "-c:v", "png", "-i", "-"]
    # Players know colours of half the size only (yuv420p), for which sides must be even. A film
    # that begins with its index starts while it is loading.
    command += ["-vf", "pad=ceil(iw/2)*2:ceil(ih/2)*2", "-c:v", "libx264", "-pix_fmt", "yuv420p"]
    command += ["-crf", "18", "-movflags", "+faststart", str(place)]
    data = b"".join(path.read_bytes() for path in frames)
    done = subprocess.run(command, input=data, capture_output=True, check=False)
    if done.returncode != 0:
        said = done.stderr.decode(errors="replace").strip()
        raise EnvironmentFault(f"ffmpeg could not write the film: {said}")
