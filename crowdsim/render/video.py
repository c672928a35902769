"""MP4 and PNG files that are whole or not there."""

from __future__ import annotations

import contextlib
import errno
import os
import shutil
import subprocess
import tempfile
from collections.abc import Iterable
from pathlib import Path

import numpy as np

from crowdsim.core.types import Array
from crowdsim.errors import OutputError
from crowdsim.render.kernels.video import to_yuv420
from crowdsim.scenario.rates import exact_rate

_ENCODER_THREADS = 4
"""Always the same, since x264's bytes depend on it."""


def ffmpeg() -> str:
    """Return the path of the ffmpeg that comes with imageio-ffmpeg.

    Raises:
        OutputError: There is none for this machine.
    """
    from imageio_ffmpeg import get_ffmpeg_exe

    try:
        program = str(get_ffmpeg_exe())
        missing = "" if shutil.which(program) else f"{program} is no program that can be run"
    except RuntimeError as error:
        missing = str(error)
    if missing:
        raise OutputError(f"no video: {missing}; set IMAGEIO_FFMPEG_EXE to an ffmpeg, or ask for PNG")
    return program


def planes(picture: Array) -> Array:
    """Return a picture (height, width, 3) of even sizes as the flat planes Y, U, V that ``encode`` takes."""
    out = np.empty(picture.shape[0] * picture.shape[1] * 3 // 2, np.uint8)
    to_yuv420(picture, out)
    return out


def encode(path: Path, pictures: Iterable[Array], size: tuple[int, int], fps: float) -> None:
    """Write pictures as H.264 that browsers play, in a process of its own; the file appears when it is whole.

    Args:
        path: The MP4 file.
        pictures: Flat planes of each frame, see ``planes``.
        size: Width and height [px], both even.
        fps: Frames a second.

    Raises:
        OutputError: The file cannot be written.
    """
    command = [
        ffmpeg(), "-v", "error", "-nostdin", "-y",
        "-f", "rawvideo", "-pix_fmt", "yuv420p", "-s", f"{size[0]}x{size[1]}", "-r", str(exact_rate(fps)),
        "-color_range", "tv", "-colorspace", "bt709", "-color_primaries", "bt709", "-color_trc", "bt709", "-i", "-",
        "-an", "-c:v", "libx264", "-preset", "veryfast", "-crf", "20", "-bf", "0", "-threads", str(_ENCODER_THREADS),
        "-pix_fmt", "yuv420p", "-color_range", "tv", "-colorspace", "bt709", "-color_primaries", "bt709",
        "-color_trc", "bt709", "-fflags", "+bitexact", "-flags:v", "+bitexact", "-map_metadata", "-1",
        "-movflags", "+faststart", "-f", "mp4",
    ]  # fmt: skip
    _run(command, path, pictures)


def join(path: Path, parts: list[Path]) -> None:
    """Put MP4 files of equal format, all in one folder and plainly named, one behind the other, without encoding again.

    Raises:
        OutputError: The file cannot be written.
    """
    listing = parts[0].with_name("parts.txt")
    try:
        if len(parts) == 1:
            os.replace(parts[0], path)
            return
        listing.write_text("".join(f"file {part.name}\n" for part in parts), encoding="ascii")
    except OSError as error:
        raise OutputError(f"{path}: cannot write video: {error.strerror or error}") from error
    command = [
        ffmpeg(), "-v", "error", "-nostdin", "-y", "-f", "concat", "-i", str(listing),
        "-c", "copy", "-fflags", "+bitexact", "-map_metadata", "-1", "-movflags", "+faststart", "-f", "mp4",
    ]  # fmt: skip
    _run(command, path, [])


def _run(command: list[str], path: Path, blocks: Iterable[Array]) -> None:
    """Feed blocks of bytes to an ffmpeg that writes beside ``path``, then rename."""
    part = path.with_name(f".{path.name}.part")
    blocks = iter(blocks)
    with contextlib.suppress(OSError):
        # The encoder of a killed process may still be writing to it.
        part.unlink()
    # Complaints go to a file, so that no full pipe can stall the encoder; its own session keeps Ctrl-C from it.
    with tempfile.TemporaryFile() as complaints:
        process = subprocess.Popen(
            [*command, str(part)],
            stdin=subprocess.PIPE,
            stdout=subprocess.DEVNULL,
            stderr=complaints,
            start_new_session=True,
        )
        try:
            assert process.stdin is not None
            try:
                for block in blocks:
                    process.stdin.write(block.data)
                process.stdin.close()
            except BrokenPipeError:
                pass
            code = process.wait()
            complaints.seek(0)
            said = complaints.read().decode(errors="replace").strip()
            if code != 0 or "No space left" in said:
                raise OutputError(
                    f"{path}: cannot write video: {said.splitlines()[-1] if said else f'ffmpeg left {code}'}"
                )
            os.replace(part, path)
        except OSError as error:
            raise OutputError(f"{path}: cannot write video: {error.strerror or error}") from error
        finally:
            if process.poll() is None:
                process.kill()
                process.wait()
            if process.stdin is not None and not process.stdin.closed:
                with contextlib.suppress(OSError):
                    process.stdin.close()
            with contextlib.suppress(OSError):
                part.unlink()


def write_png(path: Path, picture: Array, mark: str = "") -> None:
    """Write a picture under a temporary name and rename it; ``mark`` is kept in it for ``has_mark``.

    Raises:
        OutputError: The file cannot be written.
    """
    from PIL import Image
    from PIL.PngImagePlugin import PngInfo

    info = PngInfo()
    if mark:
        info.add_text("crowdsim", mark)
    part = path.with_name(f".{path.name}.part")
    try:
        Image.fromarray(picture).save(part, format="PNG", compress_level=1, pnginfo=info)
        os.replace(part, path)
    except OSError as error:
        full = ", the disk is full" if error.errno == errno.ENOSPC else ""
        raise OutputError(f"{path}: cannot write picture: {error.strerror or error}{full}") from error
    finally:
        with contextlib.suppress(OSError):
            part.unlink()


def has_mark(path: Path, mark: str) -> bool:
    """Whether a PNG file is there and holds this mark, so that it need not be drawn again."""
    from PIL import Image, UnidentifiedImageError

    try:
        with Image.open(path) as image:
            return bool(image.info.get("crowdsim") == mark)
    except (OSError, UnidentifiedImageError):
        return False
