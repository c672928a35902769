"""Makes the pictures of the documentation.

    python docs/make_pictures.py [NAME ...]

``animation`` is the animated picture of the brawl (``brawl_30.webp``), ``thumbnails`` a picture of every shipped
scenario, ``performer`` the moves of the embedded boxer, ``scaling`` the cost of control by the number of avatars,
``player`` the player in a browser and ``play`` what it plays live, which need Chromium; without a name all are made.
Scenarios of real capture need CROWDSIM_MOCAP and are left out without it; policies that are missing are trained.
"""

from __future__ import annotations

import argparse
import os
import subprocess
import sys
import tempfile
from pathlib import Path

from PIL import Image

ROOT = Path(__file__).resolve().parents[1]
DOCS = ROOT / "docs"
SCENARIOS = sorted(path.stem for path in (ROOT / "scenarios").glob("*.yaml"))
LENGTHS = {"crowd_10k": 60, "crowd_100k": 20, "crowd_1m": 4}
MOST_FRAMES = 300
OF_CAPTURE = ("cmu",)
HUGE = ("crowd_1m",)
CAMERAS = {"alley": "along"}
"""Cameras of scenarios whose obstacles would hide avatars from others."""
MANY = "crowd_"
"""Crowds of which one moment is shown, whole and from behind a shoulder."""
ANIMATION = DOCS / "brawl_30.webp"
SECONDS, FPS, WIDTH, HEIGHT = (8, 14), 10, 480, 270
MOST_BYTES = 1_500_000


def crowdsim(*arguments: str) -> None:
    """Run a command, and stop when it fails."""
    subprocess.run([sys.executable, "-m", "crowdsim.cli", *arguments], check=True, cwd=ROOT)


def shrink(source: Path, target: Path, width: int) -> None:
    """Save a picture at another width, with few colours, so that it stays small."""
    with Image.open(source) as picture:
        size = (width, round(picture.height * width / picture.width))
        small = picture.convert("RGB").resize(size, Image.Resampling.LANCZOS)
        # Rare colours keep a place of their own, and the means are then moved to where most pixels are.
        few = small.quantize(256, method=Image.Quantize.MAXCOVERAGE, kmeans=8, dither=Image.Dither.NONE)
        few.save(target, optimize=True)


def make_animation() -> None:
    """Draw six seconds of the brawl at twice the size, and save them as an animated picture."""
    with tempfile.TemporaryDirectory() as folder:
        run, pictures = Path(folder) / "brawl_30", Path(folder) / "pictures"
        without = [flag for kind in ("bvh", "ply") for flag in ("--set", f"outputs.{kind}=null")]
        crowdsim("run", "brawl_30", "--out", str(run), "--frames", f"{SECONDS[1] + 1}s", *without)
        frames = ("--frames", f"{SECONDS[0]}s:{SECONDS[1]}s", "--fps", str(FPS))
        size = ("--size", f"{2 * WIDTH}x{2 * HEIGHT}", "--no-caption")
        crowdsim("render", str(run), "--out", str(pictures), "--png", *frames, *size)
        first, *others = [smaller(path) for path in sorted((pictures / "frames").glob("*.png"))]
    first.save(ANIMATION, save_all=True, append_images=others, duration=1000 // FPS, loop=0, quality=75, method=6)
    size_of_file = ANIMATION.stat().st_size
    if size_of_file > MOST_BYTES:
        raise SystemExit(f"{ANIMATION.name} has {size_of_file:,} bytes, expected at most {MOST_BYTES:,}")


def smaller(path: Path) -> Image.Image:
    """Return a picture at the size of the animation."""
    with Image.open(path) as picture:
        return picture.convert("RGB").resize((WIDTH, HEIGHT), Image.Resampling.LANCZOS)


def make_thumbnails() -> None:
    """Draw a picture of every shipped scenario."""
    thumbnails = DOCS / "thumbnails"
    thumbnails.mkdir(exist_ok=True)
    with tempfile.TemporaryDirectory() as folder:
        for name in SCENARIOS:
            if name in HUGE or (any(word in name for word in OF_CAPTURE) and not os.environ.get("CROWDSIM_MOCAP")):
                print(f"{name}: left out", file=sys.stderr)
                continue
            run, pictures = Path(folder) / name, Path(folder) / f"{name}_pictures"
            frames = str(LENGTHS.get(name, MOST_FRAMES))
            without = [flag for kind in ("bvh", "ply", "pcd", "render") for flag in ("--set", f"outputs.{kind}=null")]
            crowdsim("run", name, "--out", str(run), "--frames", frames, *without)
            how = ["--contact-sheet", "2", "--size", "960x540"]
            how += ["--camera", CAMERAS[name]] if name in CAMERAS else []
            if name.startswith(MANY):
                how = ["--contact-sheet", "1", "--size", "1920x540", "--camera", "auto+follow:0"]
            crowdsim("render", str(run), "--out", str(pictures), *how)
            shrink(pictures / "contact_sheet.png", thumbnails / f"{name}.png", 640)


def make_performer() -> None:
    """Draw the moves of the embedded boxer."""
    subprocess.run([sys.executable, str(DOCS / "performer_sheet.py")], check=True, cwd=ROOT)


def make_scaling() -> None:
    """Draw what control costs by the number of avatars."""
    with tempfile.TemporaryDirectory() as folder:
        numbers = ("--avatars", "30,100,1k,10k,100k,1m", "--threads", "1,2", "--frames", "60")
        crowdsim("profile", "crowd_10k", *numbers, "--out", folder)
        shrink(Path(folder) / "scaling.png", DOCS / "performance" / "scaling.png", 770)


def make_player() -> None:
    """Draw the player of a brawl until one is left, with an avatar chosen."""
    sys.path.append(str(ROOT / "benchmarks"))
    from _chromium import Browser

    with tempfile.TemporaryDirectory() as folder:
        run, page = Path(folder) / "brawl", Path(folder) / "page.html"
        without = [flag for kind in ("bvh", "ply") for flag in ("--set", f"outputs.{kind}=null")]
        crowdsim("run", "brawl_last_standing", "--out", str(run), "--frames", "40s", *without)
        crowdsim("view", str(run), "--html", str(page))
        with Browser((1280, 760)) as browser:
            browser.shown(page)
            browser.evaluate("crowdsimPlayer.play(false); crowdsimPlayer.seek(33.3); crowdsimPlayer.select(7)")
            browser.evaluate("crowdsimPlayer.set('labels', true)")
            browser.settle()
            (Path(folder) / "player.png").write_bytes(browser.screenshot())
        with Image.open(Path(folder) / "player.png") as picture:
            picture.convert("RGB").save(DOCS / "player.webp", quality=82, method=6)


def make_play() -> None:
    """Draw a boxer that strikes at a target that was dragged."""
    sys.path.append(str(ROOT / "benchmarks"))
    from _chromium import Browser

    command = [sys.executable, "-m", "crowdsim.cli", "play", "boxer", "--no-open"]
    with (
        tempfile.TemporaryDirectory() as folder,
        subprocess.Popen(
            [*command, "--out", str(Path(folder) / "run")], stdout=subprocess.PIPE, text=True, cwd=ROOT
        ) as process,
    ):
        assert process.stdout is not None
        try:
            with Browser((1280, 760)) as browser:
                browser.shown(process.stdout.readline().strip())
                place = {"do": "drag", "target": 0, "x": 0.6, "y": 1.5, "z": 1.6}
                browser.evaluate(f"crowdsimPlayer.recording.send({place})")
                browser.wait("crowdsimPlayer.counts?.landed > 2")
                # A frame in which the fist is at the target.
                browser.wait(
                    "crowdsimPlayer.facts.landed.some(i => Math.abs(crowdsimPlayer.scene.tables.strike_time[i]"
                    " - crowdsimPlayer.time - 0.1) < 0.1)"
                )
                browser.evaluate("crowdsimPlayer.play(false)")
                browser.settle()
                (Path(folder) / "play.png").write_bytes(browser.screenshot())
        finally:
            process.terminate()
        with Image.open(Path(folder) / "play.png") as picture:
            picture.convert("RGB").save(DOCS / "play.webp", quality=82, method=6)


PICTURES = {
    "animation": make_animation,
    "thumbnails": make_thumbnails,
    "performer": make_performer,
    "scaling": make_scaling,
    "player": make_player,
    "play": make_play,
}


def main() -> None:
    """Make the pictures that are asked for."""
    parser = argparse.ArgumentParser(description="Makes the pictures of the documentation.")
    parser.add_argument("names", nargs="*", metavar="NAME", help=f"of {', '.join(PICTURES)}; all by default")
    options = parser.parse_args()
    unknown = [name for name in options.names if name not in PICTURES]
    if unknown:
        parser.error(f"no picture {unknown[0]!r}, there are {', '.join(PICTURES)}")
    for name in options.names or PICTURES:
        PICTURES[name]()


if __name__ == "__main__":
    main()
