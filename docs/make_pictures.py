"""Makes the pictures of the documentation: ``python docs/make_pictures.py``, or ``make docs-pictures``.

A contact sheet of the brawl, a thumbnail of every shipped scenario, and the moves of the embedded boxer. Scenarios of
real capture need CROWDSIM_MOCAP and are left out without it; policies are trained where need be. It takes two minutes.
"""

from __future__ import annotations

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
MANY = "crowd_"
"""Crowds of which one moment is shown, whole and from behind a shoulder."""


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


def main() -> None:
    """Make all pictures."""
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
            sheet = "9" if name == "brawl_30" else "2"
            how = ["--contact-sheet", sheet, "--size", "960x540"]
            if name.startswith(MANY):
                how = ["--contact-sheet", "1", "--size", "1920x540", "--camera", "auto+follow:0"]
            crowdsim("render", str(run), "--out", str(pictures), *how)
            shrink(pictures / "contact_sheet.png", thumbnails / f"{name}.png", 640)
            if name == "brawl_30":
                shrink(pictures / "contact_sheet.png", DOCS / "brawl_30.png", 1440)
    if (DOCS / "performer_sheet.py").exists():
        subprocess.run([sys.executable, str(DOCS / "performer_sheet.py")], check=True, cwd=ROOT)


if __name__ == "__main__":
    main()
