"""What ships with the package: scenarios and policies, found by path or name, and its code.

A name is looked up in the working folder first. In a wheel the shipped ones are the packages ``crowdsim.scenarios`` and
``crowdsim.policies``; in a checkout they are the folders ``scenarios/`` and ``policies/`` beside the package.
"""

from __future__ import annotations

import hashlib
import os
from functools import cache
from pathlib import Path

from crowdsim.core.types import FileName
from crowdsim.errors import CrowdsimError, PolicyError, RecipeError, ScenarioError, nearest
from crowdsim.jit.environment import cache_folder


def folders(kind: str) -> list[Path]:
    """Return the folders searched for ``kind``, ``"scenarios"`` or ``"policies"``, the first one first."""
    found = [Path.cwd() / kind, *_shipped_folders(kind)]
    return [folder for i, folder in enumerate(found) if folder.is_dir() and folder not in found[:i]]


def shipped(kind: str, name: str) -> Path:
    """Return a file of ``kind`` that ships with the package, whatever the working folder holds."""
    return _shipped_folders(kind)[0] / name


def _shipped_folders(kind: str) -> list[Path]:
    """Return the folder that ships with the package, beside its modules or beside itself; none where it is missing."""
    package = Path(__file__).resolve().parent
    return [folder for folder in (package / kind, package.parent / kind) if folder.is_dir()][:1]


def scenario_names() -> list[str]:
    """Return the names of the scenarios that can be found by name."""
    return _names("scenarios")


def recipe_names() -> list[str]:
    """Return the names of the training recipes that can be found by name."""
    return _names("policies")


def policy_names() -> list[str]:
    """Return the names of the policies that can be found by name: recipes, and trained bundles without a recipe."""
    bundles = {path.parent.name for folder in folders("policies") for path in folder.glob("*/policy.json")}
    return sorted({*_names("policies"), *bundles})


def find_scenario(name: FileName) -> Path:
    """Return the file of a scenario that is given by its path or its name.

    Raises:
        ScenarioError: There is none; the message names those there are.
    """
    return _find(name, "scenarios", "scenario", ScenarioError)


def find_recipe(name: FileName) -> Path:
    """Return the file of a training recipe that is given by its path or its name.

    Raises:
        RecipeError: There is none; the message names those there are.
    """
    return _find(name, "policies", "recipe", RecipeError)


def bundle_folder(recipe: FileName) -> Path:
    """Return where the bundle of a recipe is written: beside it, or in the user's cache.

    That is where it goes when the folder beside the recipe is read-only, or the package holds a packed policy.
    """
    recipe = Path(recipe)
    beside = shared_folder(recipe)
    writable = os.access(recipe.parent, os.W_OK) and (not beside.exists() or os.access(beside, os.W_OK))
    if packed_policy(recipe) is None and writable:
        return beside
    cache = _cache()
    return beside if cache is None else cache / recipe.stem


def shared_folder(recipe: FileName) -> Path:
    """Return the folder beside a recipe, where those who may write there leave its bundle for all users."""
    return Path(recipe).parent / Path(recipe).stem


def packed_policy(recipe: FileName) -> Path | None:
    """Return the packed policy of a recipe, as a wheel holds them (``training.packing``); None where there is none."""
    recipe = Path(recipe)
    path = recipe.parent / "packed" / f"{recipe.stem}.json"
    return path if path.is_file() else None


def find_bundle(name: FileName) -> Path:
    """Return the folder of a trained bundle that is given by its path, its recipe's path or its name.

    Raises:
        PolicyError: There is none; the message says what to train, or names the policies there are.
    """
    path = Path(name)
    if (path / "policy.json").is_file():
        return path
    if path.is_file() and path.suffix in (".yaml", ".yml"):
        return _trained(path)
    if len(path.parts) == 1 or path.parent == Path("policies"):
        for folder in folders("policies"):
            recipe = folder / f"{path.stem}.yaml"
            if recipe.is_file():
                return _trained(recipe)
            if (folder / path.name / "policy.json").is_file():
                return folder / path.name
    if path.is_dir():
        raise PolicyError(f"{path}: is no trained policy, expected a folder with policy.json")
    raise PolicyError(f"{name}: no such policy{_choices(path.stem, 'policies', policy_names())}")


@cache
def sources_hash(folders: tuple[str, ...]) -> str:
    """Return the fingerprint of the code in some folders of the package, as this process has found it."""
    package = Path(__file__).resolve().parent
    digest = hashlib.sha256()
    for name in folders:
        for path in sorted((package / name).rglob("*.py")):
            digest.update(f"{path.relative_to(package).as_posix()}\n".encode())
            digest.update(path.read_bytes().replace(b"\r\n", b"\n"))
    return digest.hexdigest()


def _trained(recipe: Path) -> Path:
    """Return the bundle of a recipe; the newer one where the user and another user have trained it."""
    written, shared = bundle_folder(recipe), shared_folder(recipe)
    found = [path for path in (written / "policy.json", shared / "policy.json") if path.is_file()]
    if not found:
        raise PolicyError(f"{recipe}: is not trained yet, expected {written}; run: crowdsim train {recipe}")
    return max(found, key=lambda path: path.stat().st_mtime).parent


def _cache() -> Path | None:
    return cache_folder("policies")


def _names(kind: str) -> list[str]:
    return sorted({path.stem for folder in folders(kind) for path in folder.glob("*.yaml")})


def _find(name: FileName, kind: str, word: str, error: type[CrowdsimError]) -> Path:
    path = Path(name)
    if path.is_file() or (path.exists() and not path.is_dir()):
        return path
    # A bare name, or one as the shipped files are called in a checkout.
    if len(path.parts) == 1 or (path.parent == Path(kind) and path.suffix in (".yaml", ".yml")):
        for folder in folders(kind):
            found = folder / (path.name if path.suffix in (".yaml", ".yml") else f"{path.name}.yaml")
            if found.is_file():
                return found
    if path.is_dir():
        raise error(f"{name}: is a folder, expected a {word}")
    raise error(f"{name}: no such {word}{_choices(path.stem, kind, _names(kind))}")


def _choices(name: str, kind: str, names: list[str]) -> str:
    if not names:
        return f", and there are no {kind} to choose from"
    return f", expected a file or one of {', '.join(names)}{nearest(name, names)}"
