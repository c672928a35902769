"""The time of stages within compiled code."""

from numba import types

from crowdsim.jit import kernel

_clock_type = types.int32(types.int32, types.CPointer(types.int64))
_clock_gettime = types.ExternalFunction("clock_gettime", _clock_type)


@kernel
def _now(buffer):
    """Return a steady time [ns]; ``buffer`` has room for two numbers."""
    _clock_gettime(1, buffer.ctypes)  # type: ignore[call-overload]
    return buffer[0] * 1_000_000_000 + buffer[1]


@kernel(inline=True)
def note_time(timings, clock, stage):
    """Write a steady time [ns] for a stage into ``clock[stage]``, whose last two entries are scratch space.

    Where ``timings`` has no rows, nothing is measured.
    """
    if timings.shape[0] > 0:
        clock[stage] = _now(clock[clock.shape[0] - 2 :])
