"""Avatars of a take as skinned bodies with their motion: one binary glTF 2.0 file."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Literal, cast

from pydantic import Field, model_validator

from crowdsim.config.files import Fault, Finding
from crowdsim.errors import CrowdsimError
from crowdsim.export.avatar_files import MAXIMUM_FILES
from crowdsim.export.posed import POSE_SECONDS, PosedOutput, extent_of
from crowdsim.export.stream import Sink
from crowdsim.scenario.camera import Camera
from crowdsim.scenario.cameras import Chosen, choice_findings
from crowdsim.scenario.output import Extent, Series

if TYPE_CHECKING:
    from crowdsim.export.gltf import CameraPath
    from crowdsim.poses.sampler import PoseSampler
    from crowdsim.take.take import Take

_FILE = "glb/take.glb"
_SIZE = 1280, 720
"""Size of the pictures that cameras are planned for [px]."""
_LARGEST = 2**32
_POSE_BYTES = {"float32": 360.0, "int16": 210.0}
"""Bytes of an avatar at a time, measured with the shipped scenarios."""
_SKIN_BYTES, _AVATAR_BYTES = 300_000.0, 8_000.0
"""Bytes of a skin, which avatars of one build share, and of the description of an avatar."""


class GlbOutput(PosedOutput):
    """Skinned bodies and their motion as binary glTF 2.0, one file for all avatars, one animation, metres, y up."""

    name = "glb"
    about = "Skinned bodies and their motion as binary glTF 2.0, one file for all avatars."
    kernels = "bodies"

    rotations: Literal["float32", "int16"] = Field(
        default="float32",
        description="How rotations are stored: `float32`, 16 bits where they move no other joint; or all as `int16`, "
        "which takes three fifths of the room.",
    )

    camera: Chosen | None = Field(
        default=None, description="A camera that comes along, as of `render`; without it none does."
    )
    split: bool = Field(
        default=False,
        description="Whether each avatar has a file of its own, with the frames in which it is there.",
    )

    @model_validator(mode="after")
    def _check(self) -> GlbOutput:
        if self.split and self.camera is not None:
            raise Fault("is given beside split, whose files have an avatar each, expected one of them", "camera")
        return self

    @classmethod
    def posed_pattern(cls) -> str:
        """Return the regular expression of the names of its files."""
        return r"glb/[^/]+\.glb"

    def posed_files(self, extent: Extent, names: Sequence[str]) -> Iterator[str | Series]:
        """Yield the name of the file, or those of avatars, in their order."""
        if self.split:
            yield from (f"{self.name}/{self.file_of(names[avatar])}" for avatar in self.chosen(len(names)))
        else:
            yield _FILE

    def file_of(self, avatar: str) -> str:
        """Return the name of the file that holds an avatar."""
        return f"{avatar}.glb" if self.split else Path(_FILE).name

    def findings(self, avatars: int) -> Iterator[Finding]:
        """Yield a finding for each avatar that there is not, and where there are too many files."""
        if self.split and self.avatars is None and avatars > MAXIMUM_FILES:
            what = f"asks for {avatars:,} files, expected at most {MAXIMUM_FILES:,}; choose some by 'avatars'"
            yield Finding(("split",), what)
        yield from super().findings(avatars)

    def named(self, members: Callable[[str], Sequence[int] | None], cameras: Mapping[str, Camera]) -> PosedOutput:
        """Return it with the numbers of its avatars and the keys of its camera."""
        keys = cameras.get(self.camera, self.camera) if isinstance(self.camera, str) else self.camera
        return super().named(members, cameras).model_copy(update={"camera": keys})

    def of_take(self, names: Sequence[str], cameras: Mapping[str, Camera]) -> PosedOutput:
        """Return it with the keys of its camera, which may be in a file, for a finished take."""
        from crowdsim.scenario.camera_files import camera_in_file

        if isinstance(self.camera, str) and (camera := camera_in_file(self.camera)) is not None:
            cameras = {**cameras, self.camera: camera}
        for finding in () if self.camera is None else choice_findings(self.camera, cameras, names):
            raise CrowdsimError(f"{self.name}: camera: {finding.message}")
        return super().of_take(names, cameras)

    def command(self, run: str) -> list[str]:
        """Return the words of the command that writes it from a finished run; none if it cannot name the camera."""
        return [] if self.camera is not None and not isinstance(self.camera, str) else super().command(run)

    def findings_for(self, extent: Extent) -> Iterator[Finding]:
        """Yield a finding where the file would be larger than glTF files can be."""
        size = self.cost(extent)[0]
        if size >= _LARGEST and not self.split:
            what = f"would have about {size / 1e9:.1f} GB, glTF files have at most {_LARGEST / 1e9:.1f}; "
            yield Finding((), what + "expected fewer avatars or frames, a lower rate, or rotations: int16")

    def cost(self, extent: Extent) -> tuple[float, float]:
        """Return about how much room the file takes [bytes], and how long one core writes it [s]."""
        avatars = len(self.chosen(extent.avatars))
        poses = avatars * self.frame_count(extent)
        return _POSE_BYTES[self.rotations] * poses + _SKIN_BYTES + _AVATAR_BYTES * avatars, POSE_SECONDS * poses

    def sink(self, sampler: PoseSampler, folder: Path, missing: Collection[str] | None = None) -> Sink:
        """Return what writes the file."""
        from crowdsim.export.gltf import GltfSink, SplitGltfSink

        frames, names = self.frames_of(extent_of(sampler.take)), sampler.take.cast.names.tolist()
        if self.split:
            files = {one: f"{self.name}/{self.file_of(names[one])}" for one in self.chosen(len(names))}
            wanted = [one for one, file in files.items() if missing is None or file in missing]
            paths = [folder / Path(files[one]).name for one in wanted]
            return SplitGltfSink(sampler, paths, self.rate, frames, wanted, self.rotations)
        cameras = [] if self.camera is None else _camera_paths(sampler, self.camera, self.rate, frames)
        return GltfSink(
            sampler, folder / Path(_FILE).name, self.rate, frames, self.numbers, self.rotations, cameras=cameras,
            resumes=missing is not None,
        )  # fmt: skip


def _camera_paths(sampler: PoseSampler, camera: Chosen, fps: float, frames: tuple[int, int]) -> list[CameraPath]:
    """Return where cameras are and look at every output frame.

    Raises:
        CrowdsimError: There is no such camera or avatar.
    """
    import numpy as np
    from scipy.spatial.transform import Rotation

    from crowdsim.export.gltf import CameraPath
    from crowdsim.render.camera import build_track, resolve_camera
    from crowdsim.render.take_source import TakeSource

    source, paths = TakeSource(cast("Take", sampler.take), sampler.policies, fps), []
    for number, one in enumerate(resolve_camera(source, camera)):
        track = build_track(source, one, _SIZE)
        views = [track.view(frame) for frame in range(*frames)]
        axes = [np.stack([view.right, np.cross(view.right, view.ahead), -view.ahead], axis=1) for view in views]
        rotations = Rotation.from_matrix(np.array(axes)).as_quat(scalar_first=True)
        name = f"camera_{number}" if number else "camera"
        eyes = np.array([view.eye for view in views])
        paths.append(CameraPath(name, eyes, rotations, views[0].field, _SIZE[0] / _SIZE[1]))
    return paths


OUTPUT = GlbOutput
