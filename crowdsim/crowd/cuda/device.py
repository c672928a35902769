"""Which device control runs on: the processor, or a GPU by CUDA."""

from __future__ import annotations

import os
from contextlib import suppress
from importlib import import_module
from importlib.util import find_spec

from crowdsim.errors import CrowdsimError, nearest

DEVICES = ("cpu", "cuda", "auto")
"""Choices of a device."""
LARGE = 100_000
"""Number of avatars from which on ``auto`` takes a GPU."""
OLDEST = (7, 0)
"""Compute capability of the oldest cards: older ones take fewer arguments than a thread has."""


class DeviceError(CrowdsimError):
    """The device that was asked for is missing, or cannot do what was asked for."""


def choose_device(wanted: str, avatars: int, search: str = "auto") -> str:
    """Return ``cpu`` or ``cuda``.

    Args:
        wanted: One of ``DEVICES``; ``auto`` is a GPU for ``LARGE`` crowds where there is one.
        avatars: Number of avatars.
        search: How nearest opponents are to be found, one of ``scenario.groups.SEARCHES``.

    Raises:
        DeviceError: It is unknown, or ``cuda`` and there is no GPU, or it cannot search like that.
    """
    check_device(wanted)
    if wanted == "cpu" or (wanted == "auto" and (avatars < LARGE or search == "scipy")):
        return "cpu"
    missing = missing_for_cuda()
    if wanted == "auto":
        return "cpu" if missing else "cuda"
    if missing:
        raise DeviceError(f"device cuda: {missing}")
    if search == "scipy":
        raise DeviceError("device cuda: cannot search by 'scipy', expected --search auto or kd_tree, or --device cpu")
    return "cuda"


def check_device(wanted: str) -> None:
    """Raise an error where a device is none of ``DEVICES``.

    Raises:
        DeviceError: It is unknown.
    """
    if wanted not in DEVICES:
        raise DeviceError(f"device is {wanted!r}, expected one of {', '.join(DEVICES)}{nearest(wanted, DEVICES)}")


def missing_for_cuda() -> str:
    """Return what is missing for control on a GPU, and what to do; an empty text where nothing is."""
    if find_spec("numba_cuda") is None:
        return "numba-cuda is not installed, expected: pip install 'crowdsim[cuda]'"
    if os.environ.get("NUMBA_ENABLE_CUDASIM", "0") not in ("", "0"):
        return ""
    from numba import cuda

    errors: tuple[type[Exception], ...] = (*driver_errors(), ImportError)
    try:
        if not cuda.is_available():
            return "found no NVIDIA GPU with a driver for CUDA 13 (580 or newer) on this machine"
        device = cuda.get_current_device()
    except errors as error:
        return f"the NVIDIA driver cannot be used: {' '.join(str(error).split())}"
    capability = device.compute_capability
    if tuple(capability)[:2] < OLDEST:
        name = device.name.decode() if isinstance(device.name, bytes) else device.name
        return (
            f"{name} has compute capability {capability[0]}.{capability[1]}, expected {OLDEST[0]}.{OLDEST[1]} or newer"
        )
    return ""


def gpu_count() -> int:
    """Return how many GPUs there are, once there is one (``choose_device``)."""
    from numba import cuda

    return len(cuda.gpus)


def take_gpu(number: int) -> None:
    """Let this process use one of the GPUs; numbers beyond these begin again with the first."""
    from numba import cuda

    cuda.select_device(number % gpu_count())


def driver_errors() -> tuple[type[Exception], ...]:
    """Return the classes of what numba raises for a GPU or its driver."""
    from numba.cuda.cudadrv import error

    names = ("CudaDriverError", "CudaSupportError", "CudaRuntimeError")
    found = [getattr(error, name) for name in names if hasattr(error, name)]
    with suppress(ImportError, AttributeError):
        found.append(import_module("cuda.core._utils.cuda_utils").CUDAError)
    return tuple(found)
