"""Videos and pictures on disk are whole or not there."""

import re
import subprocess

import naive_raycast as naive
import numpy as np
import pytest
from PIL import Image

from crowdsim.errors import OutputError
from crowdsim.render import video


def pictures(count, size=(64, 48), seed=0):
    rng = np.random.default_rng(seed)
    base = rng.integers(0, 255, (size[1] // 8, size[0] // 8, 3)).repeat(8, 0).repeat(8, 1)
    return [np.roll(base, i, axis=1).astype(np.uint8) for i in range(count)]


def describe(path):
    """What ffmpeg says about a file, and how many frames it decodes."""
    said = subprocess.run(
        [video.ffmpeg(), "-i", str(path), "-f", "null", "-"], capture_output=True, text=True, check=True
    ).stderr
    return said, int(re.findall(r"frame=\s*(\d+)", said)[-1])


def decode(path, size):
    raw = subprocess.run(
        [video.ffmpeg(), "-v", "error", "-i", str(path), "-f", "rawvideo", "-pix_fmt", "rgb24", "-"],
        capture_output=True,
        check=True,
    ).stdout
    return np.frombuffer(raw, np.uint8).reshape(-1, size[1], size[0], 3)


def test_planes_are_bt709_in_limited_range():
    picture = np.random.default_rng(2).integers(0, 256, (6, 8, 3), dtype=np.uint8)
    flat = video.planes(picture).astype(float)
    y, u, v = naive.to_yuv(picture)
    assert flat[:48].reshape(6, 8) == pytest.approx(y, abs=0.52)
    assert flat[48:60].reshape(3, 4) == pytest.approx(u, abs=0.52)
    assert flat[60:].reshape(3, 4) == pytest.approx(v, abs=0.52)


def test_a_video_is_h264_that_browsers_play_and_shows_the_pictures(tmp_path):
    path = tmp_path / "video.mp4"
    shown = pictures(12)
    video.encode(path, (video.planes(picture) for picture in shown), (64, 48), 24.0)
    said, frames = describe(path)
    assert frames == 12
    assert "h264 (High)" in said
    assert "yuv420p(tv, bt709" in said
    assert "64x48" in said
    assert "24 fps" in said
    error = np.abs(decode(path, (64, 48)).astype(int) - np.array(shown)).mean()
    assert error < 12
    assert path.read_bytes().find(b"moov") < path.read_bytes().find(b"mdat")
    assert [item.name for item in tmp_path.iterdir()] == ["video.mp4"]


def test_the_same_pictures_give_the_same_bytes(tmp_path):
    for name in ("a.mp4", "b.mp4"):
        video.encode(tmp_path / name, (video.planes(picture) for picture in pictures(5)), (64, 48), 30.0)
    assert (tmp_path / "a.mp4").read_bytes() == (tmp_path / "b.mp4").read_bytes()


def test_parts_join_to_a_whole(tmp_path):
    shown = pictures(14)
    parts = []
    for start, stop in ((0, 6), (6, 12), (12, 14)):
        parts.append(tmp_path / f"{start:08d}.mp4")
        video.encode(parts[-1], (video.planes(picture) for picture in shown[start:stop]), (64, 48), 30.0)
    video.join(tmp_path / "whole.mp4", parts)
    _, frames = describe(tmp_path / "whole.mp4")
    assert frames == 14
    whole = decode(tmp_path / "whole.mp4", (64, 48))
    np.testing.assert_array_equal(whole, np.concatenate([decode(part, (64, 48)) for part in parts]))


def test_an_interrupted_video_leaves_nothing(tmp_path):
    def broken():
        yield video.planes(pictures(1)[0])
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        video.encode(tmp_path / "video.mp4", broken(), (64, 48), 30.0)
    assert list(tmp_path.iterdir()) == []


def test_a_video_that_cannot_be_written_is_reported_with_path_and_reason(tmp_path):
    (tmp_path / "file").write_text("")
    with pytest.raises(OutputError, match=r"file/video\.mp4: cannot write video: .*Not a directory"):
        video.encode(tmp_path / "file" / "video.mp4", [video.planes(pictures(1)[0])], (64, 48), 30.0)


def test_pictures_keep_their_mark(tmp_path):
    path = tmp_path / "000000.png"
    shown = pictures(1)[0]
    video.write_png(path, shown, "abc")
    assert video.has_mark(path, "abc")
    assert not video.has_mark(path, "abd")
    assert not video.has_mark(tmp_path / "000001.png", "abc")
    np.testing.assert_array_equal(np.asarray(Image.open(path)), shown)
    path.write_bytes(path.read_bytes()[:60])
    assert not video.has_mark(path, "abc")


def test_a_full_disk_leaves_no_picture(tmp_path, monkeypatch):
    def full(self, path, **options):
        path.write_bytes(b"half")
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(Image.Image, "save", full)
    with pytest.raises(OutputError, match=r"a\.png: cannot write picture: No space left on device, the disk is full"):
        video.write_png(tmp_path / "a.png", pictures(1)[0])
    assert list(tmp_path.iterdir()) == []
