"""What kernels cost to compile, by package, and that the list of what each is called with is up to date.

    python benchmarks/compilation.py [--json] [--quick] [--write]

A policy is trained, a few and many avatars are run, and every output is written, each in a process of its own, with
nothing compiled before. Seconds are CPU time of the compiler, each kernel without those that it calls. ``signatures``
counts the kernels whose arguments differ from what ``crowdsim/jit/signatures.json`` says; ``--write`` writes it anew.
With ``--quick`` only the training is done.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
import tempfile
import threading
import time
from collections import Counter
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import yaml
from _quick import ROOT, command_line, small_policies

from crowdsim.jit.signatures import Listed, encode, listed, write

POLICIES = {"uint16": "boxer", "uint8": "boxer_crowd", "float32": "boxer_float32"}
"""Policies whose tables control reads as these types; the last is the first, stored otherwise."""
CROWDS = [f"{size} {kind}" for size in ("few", "many") for kind in POLICIES]
USES = ("training", *CROWDS, "bvh", "clouds", "bodies", "pictures")


def watch() -> tuple[list[dict[str, Any]], list[dict[str, Any]]]:
    """Return lists that fill up: kernels that Python calls, in this order, and all that are compiled."""
    from numba.core import event

    from crowdsim.jit.cache import KernelCache

    called: list[dict[str, Any]] = []
    compiled: list[dict[str, Any]] = []
    load = KernelCache.load_overload
    stacks: dict[int, list[list[float]]] = {}

    def note(self: Any, signature: Any, context: Any) -> Any:
        function = self._py_func
        if not self._part:
            arguments = [encode(kind) for kind in signature]
            called.append({"module": function.__module__, "name": function.__qualname__, "arguments": arguments})
        return load(self, signature, context)

    class Listener(event.Listener):  # type: ignore[misc]
        def on_start(self, event: Any) -> None:
            stacks.setdefault(threading.get_ident(), []).append([time.thread_time(), 0.0])

        def on_end(self, event: Any) -> None:
            stack = stacks[threading.get_ident()]
            started, inner = stack.pop()
            seconds = time.thread_time() - started
            if stack:
                stack[-1][1] += seconds
            function = event.data["dispatcher"].py_func
            compiled.append({
                "module": function.__module__, "name": function.__qualname__, "seconds": seconds - inner,
                "part": bool(event.data["dispatcher"].targetoptions.get("no_cpython_wrapper")),
            })  # fmt: skip

    KernelCache.load_overload = note  # type: ignore[method-assign]
    event.register("numba:compile", Listener())
    return called, compiled


def commands(use: str, folder: Path) -> list[list[str]]:
    """Return the commands that a use stands for; on one thread, so that no other process compiles."""
    if use in CROWDS:
        size, kind = use.split()
        scene = (
            ["brawl_30", "--frames", "120"] if size == "few" else ["crowd_10k", "--frames", "30", "--fraction", "0.1"]
        )
        chosen = ["--set", "outputs={}", "--set", f"types.boxer={{policy: {POLICIES[kind]}}}"]
        return [["run", *scene, "--out", str(folder / use), *chosen]]
    run = str(folder / CROWDS[0])
    return {
        "training": [["train", name, "--force"] for name in POLICIES.values()],
        "bvh": [["export", run, "--bvh", "--out", str(folder)]],
        "bodies": [["export", run, "--glb", "--clips", "--out", str(folder)]],
        "clouds": [
            ["export", run, "--ply", "--out", str(folder)],
            ["export", run, "--ply", "--surface", "body", "--out", str(folder / "on_skins")],
        ],
        "pictures": [["render", run, "--out", str(folder / "pictures"), "--frames", "80:82"]],
    }[use]


def work(use: str, folder: Path) -> None:
    """Run the commands of a use, and print what they called and compiled."""
    called, compiled = watch()
    from crowdsim.cli import main

    for words in commands(use, folder):
        sys.argv = ["crowdsim", *words, "--threads", "1", "--quiet"]
        try:
            main()
        except SystemExit as leave:
            if leave.code:
                raise
    print(json.dumps({"called": called, "compiled": compiled}))


@contextmanager
def recipes() -> Iterator[None]:
    """Work in a folder with the shipped recipes of the embedded boxer, shortened, and one of float32."""
    with small_policies():
        for name in POLICIES.values():
            path = Path("policies") / f"{name.removesuffix('_float32')}.yaml"
            recipe = yaml.safe_load(path.read_text(encoding="utf-8"))
            shipped = yaml.safe_load((ROOT / path).read_text(encoding="utf-8"))
            if name.endswith("float32"):
                path, recipe["precision"] = path.with_stem(name), "float32"
            recipe["motion"] = {**shipped["motion"], "performer": {**shipped["motion"]["performer"], "seconds": 60}}
            recipe["graph"], recipe["prune"] = {**shipped["graph"], "branching": 8}, shipped["prune"]
            for label, behaviour in recipe["behaviours"].items():
                behaviour["finer"] = shipped["behaviours"][label].get("finer", 1)
            path.write_text(yaml.safe_dump(recipe, sort_keys=False), encoding="utf-8")
        yield


def measure(quick: bool) -> dict[str, Any]:
    """Return kernels and seconds by package, and the list of what is called."""
    found: dict[str, Listed] = {}
    rows: list[dict[str, Any]] = []
    with recipes(), tempfile.TemporaryDirectory() as kernels, tempfile.TemporaryDirectory() as folder:
        for use in USES[:1] if quick else USES:
            done = subprocess.run(
                [sys.executable, __file__, "--use", use, "--folder", folder],
                capture_output=True, text=True, check=False, env={**os.environ, "NUMBA_CACHE_DIR": kernels},
            )  # fmt: skip
            if done.returncode:
                sys.exit(done.stderr.strip() or f"{use} failed")
            document = json.loads(done.stdout.splitlines()[-1])
            rows += document["compiled"]
            for one in document["called"]:
                # The duels that end training are of one type of table, and wait for their kernels themselves.
                if use == "training" and one["module"].startswith("crowdsim.crowd."):
                    continue
                key = json.dumps(one)
                found.setdefault(key, Listed(uses=[], **one))
                if use not in found[key].uses:
                    found[key].uses.append(use)
    return {"entries": list(found.values()), "rows": rows}


def summarise(rows: list[dict[str, Any]]) -> list[dict[str, Any]]:
    """Return, by package, its kernels, how often they were compiled, and the seconds that took."""
    packages: dict[str, dict[str, Any]] = {}
    for row in rows:
        parts = row["module"].split(".")
        name = parts[1] if parts[0] == "crowdsim" else "numba's own"
        one = packages.setdefault(name, {"package": name, "kernels": set(), "compiled": 0, "seconds": 0.0})
        one["kernels"].add((row["module"], row["name"]))
        one["compiled"] += 1
        one["seconds"] += row["seconds"]
    ordered = sorted(packages.values(), key=lambda one: -one["seconds"])
    return [{**one, "kernels": len(one["kernels"])} for one in ordered]


def several(rows: list[dict[str, Any]]) -> dict[str, int]:
    """Return the package's kernels that are compiled for more than one signature, and for how many.

    One that Python calls and kernels call is compiled once for each.
    """
    counts = Counter(
        (f"{row['module'].removeprefix('crowdsim.')}.{row['name']}", row["part"])
        for row in rows
        if row["module"].startswith("crowdsim.")
    )
    found: dict[str, int] = {}
    for (name, _), count in sorted(counts.items()):
        if count > 1:
            found[name] = max(count, found.get(name, 0))
    return found


def main() -> None:
    parser = command_line("What kernels cost to compile.", "a minute: the training alone")
    parser.add_argument("--write", action="store_true", help="write crowdsim/jit/signatures.json")
    parser.add_argument("--use", choices=USES, help=argparse.SUPPRESS)
    parser.add_argument("--folder", help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.use:
        work(options.use, Path(options.folder))
        return
    outcome = measure(options.quick)
    before = {json.dumps(one[:2] + one[3:]) for one in listed(("training",) if options.quick else ())}
    now = {json.dumps(one[:2] + one[3:]) for one in outcome["entries"]}
    if options.write:
        write(outcome["entries"])
    packages = summarise(outcome["rows"])
    report = {
        "packages": packages,
        "several": several(outcome["rows"]),
        "kernels": sum(one["kernels"] for one in packages),
        "compiled": sum(one["compiled"] for one in packages),
        "seconds": sum(one["seconds"] for one in packages),
        "signatures": len(now ^ before),
    }
    if options.json:
        print(json.dumps(report, indent=2))
        return
    print(f"{'':<16}{'kernels':>9}{'compiled':>9}{'seconds':>9}")
    for one in [*packages, {"package": "all", **report}]:
        print(f"{one['package']:<16}{one['kernels']:>9}{one['compiled']:>9}{one['seconds']:>9.1f}")
    for name, count in report["several"].items():
        print(f"{name}: {count} signatures")
    print(f"kernels whose arguments differ from crowdsim/jit/signatures.json: {report['signatures']}")


if __name__ == "__main__":
    main()
