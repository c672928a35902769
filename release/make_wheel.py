"""Builds the wheel: the package, its scenarios and recipes, and the policies of the embedded boxer, trained and packed.

Policies are trained first where they are missing or stale. The wheel is built from a copy of the sources, since a
checkout holds no packed policy: it trains.
"""

from __future__ import annotations

import argparse
import os
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

from crowdsim.training.packing import pack_policy
from crowdsim.training.train import train_recipe

ROOT = Path(__file__).resolve().parents[1]
POLICIES = ("boxer", "boxer_crowd")
SOURCES = ("pyproject.toml", "README.md", "LICENSE", "crowdsim", "scenarios")
LIMIT = 48_000_000
"""Most bytes of the wheel."""


def build_wheel(out: Path, threads: int) -> Path:
    """Return the wheel, built into a folder.

    Raises:
        subprocess.CalledProcessError: pip cannot build it.
        RuntimeError: It is larger than ``LIMIT``.
    """
    trained = [_trained(name, threads) for name in POLICIES]
    out.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory(prefix=".wheel-", dir=out) as temporary:
        copy = Path(temporary)
        for name in SOURCES:
            if (ROOT / name).is_dir():
                shutil.copytree(ROOT / name, copy / name, ignore=shutil.ignore_patterns("__pycache__"))
            else:
                shutil.copy(ROOT / name, copy)
        (copy / "policies").mkdir()
        for recipe in (ROOT / "policies").glob("*.yaml"):
            shutil.copy(recipe, copy / "policies")
        for folder in trained:
            print(f"packing policy {folder.name}", flush=True)
            pack_policy(folder, copy / "policies" / "packed")
        command = [sys.executable, "-m", "pip", "wheel", "--quiet", "--disable-pip-version-check", "--no-deps"]
        subprocess.run([*command, "--wheel-dir", str(copy / "dist"), str(copy)], check=True)
        wheel = next((copy / "dist").glob("*.whl"))
        if wheel.stat().st_size > LIMIT:
            raise RuntimeError(f"{wheel.name}: has {wheel.stat().st_size:,} bytes, expected at most {LIMIT:,}")
        return wheel.replace(out / wheel.name)


def _trained(name: str, threads: int) -> Path:
    """Return the bundle of a shipped recipe, trained where it is missing or stale."""
    print(f"training policy {name}, if it is missing or stale", flush=True)
    return train_recipe(ROOT / "policies" / f"{name}.yaml", threads=threads)[0]


def main() -> None:
    """Build the wheel by the options of the command line."""
    parser = argparse.ArgumentParser(description="Builds the wheel, trained policies included.")
    parser.add_argument("--out", type=Path, default=ROOT / "dist", help="folder of the wheel")
    parser.add_argument("--threads", type=int, default=os.cpu_count() or 1, help="threads for training")
    options = parser.parse_args()
    wheel = build_wheel(options.out, options.threads)
    print(f"{wheel}: {wheel.stat().st_size / 1e6:.1f} MB")


if __name__ == "__main__":
    main()
