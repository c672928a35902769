"""Fields of avatars by name, wherever they are stored."""

import numpy as np


def field(avatars, name):
    """Return a field of all slots, as a view."""
    if name.startswith("slide_"):
        return avatars.slides[name.removeprefix("slide_")]
    if name in avatars._fields:
        return getattr(avatars, name)
    return next(part[name] for part in (avatars.motion, avatars.playback, avatars.fight) if name in part.dtype.names)


def fields(avatars, names, slot=slice(None)):
    """Return some fields, named in one text, of one slot or of all."""
    return np.array([field(avatars, name)[slot] for name in names.split()])


def set_fields(avatars, names, slot, values):
    """Set some fields, named in one text, of one slot or of all."""
    names = names.split()
    for name, value in zip(names, np.broadcast_to(values, (len(names), *np.shape(values)[1:])), strict=True):
        field(avatars, name)[slot] = value


def base(model, avatars, slot):
    """Return where the action of an avatar that does not slide is based: x and z."""
    motion, playback = avatars.motion[slot], avatars.playback[slot]
    stride = model.policies["stride"][avatars.policy[slot]]
    end = model.ground[model.actions["origin"][motion["action"]] + model.actions["length"][motion["action"]] * stride]
    cos, sin = (playback["scale"] * part(playback["base_turn"]) for part in (np.cos, np.sin))
    x, z = motion["end_x"] - end["x"] * cos - end["z"] * sin, motion["end_z"] + end["x"] * sin - end["z"] * cos
    return np.array([x, z])


def set_situations(scratch, columns):
    """Set the first fields of the situations of a batch, a column each."""
    for name, column in zip(scratch.situations.dtype.names, np.transpose(columns), strict=False):
        scratch.situations[name] = column


def place(record):
    """Return x, z and heading of ground transforms as one array. Shape (..., 3)."""
    return np.stack([record[name] for name in ("x", "z", "heading")], axis=-1)
