"""Files of cameras and shots."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

from pydantic import Field, model_validator

from crowdsim.config.files import Faults, Finding, StrictModel, load_model
from crowdsim.errors import CrowdsimError, nearest
from crowdsim.scenario.camera import Camera
from crowdsim.scenario.cameras import MOST, Cameras, Shots, shot_faults
from crowdsim.scenario.scenario import load_scenario


class CameraFile(StrictModel):
    """A file of cameras, and of shots that they take."""

    cameras: Cameras = Field(default_factory=dict, max_length=MOST, description="Cameras by name.")
    shots: Shots = Field(default=(), description="Shots of an edited video, in their order.")

    @model_validator(mode="after")
    def _check(self) -> CameraFile:
        findings = [
            Finding(("shots", i, *finding.loc), finding.message)
            for i, shot in enumerate(self.shots)
            for finding in shot_faults(shot, self.cameras, None)
        ]
        if findings:
            raise Faults(findings)
        return self


def load_cameras(path: Path) -> CameraFile:
    """Return the cameras and shots of a file, which may be a scenario.

    Raises:
        CrowdsimError: The file cannot be read or is invalid.
    """
    text = path.read_text(encoding="utf-8", errors="replace") if path.is_file() else ""
    if re.search(r"^groups\s*:", text, re.MULTILINE):
        scenario = load_scenario(path)
        render = scenario.outputs.render
        return CameraFile(cameras=scenario.cameras, shots=() if render is None else render.shots)
    return load_model(path, CameraFile, CrowdsimError)


def read_shots(path: Path) -> tuple[Any, ...]:
    """Return the shots of a file, which may be a scenario, with the keys of their cameras.

    Raises:
        CrowdsimError: The file cannot be read, is invalid, or has no shots.
    """
    file = load_cameras(path)
    if not file.shots:
        raise CrowdsimError(f"{path}: has no shots, expected a list 'shots' of mappings with camera, from and to")
    return tuple(
        shot.model_copy(update={"camera": file.cameras.get(shot.camera, shot.camera)})
        if isinstance(shot.camera, str)
        else shot
        for shot in file.shots
    )


def camera_in_file(text: str) -> Camera | None:
    """Return the camera that ``FILE.yaml#name`` means; None where the text is no such thing.

    Raises:
        CrowdsimError: The file is invalid, or has no such camera.
    """
    match = re.fullmatch(r"(.+\.ya?ml)(?:#(.*))?", text, re.IGNORECASE)
    if match is None:
        return None
    cameras = load_cameras(Path(match[1])).cameras
    name = match[2] if match[2] else next(iter(cameras), "") if len(cameras) == 1 else ""
    if name not in cameras:
        known = f"expected {match[1]}#NAME with one of {', '.join(cameras)}" if cameras else "the file has no cameras"
        raise CrowdsimError(f"camera {text!r} is unknown, {known}{nearest(name, cameras)}")
    return cameras[name]
