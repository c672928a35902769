"""Names, types and units of what a take holds on disk; FORMAT.md beside this file."""

from crowdsim.crowd.events import OUTCOMES
from crowdsim.scenario.parts import STANCES

FORMAT = "crowdsim-take"
VERSION = 1
DTYPES = {"action": "<i4", "action_frame": "<f4", "x": "<f4", "z": "<f4", "heading": "<f4", "opponent": "<i4"}
LABELS = {
    "time": ("s", "time since the first control frame"),
    "action": ("1", "number of the action in its policy's motion graph, -1 while absent"),
    "action_frame": ("control frames", "control frames of the action done"),
    "x": ("m", "position along x"),
    "z": ("m", "position along z"),
    "heading": ("rad", "heading, rotation about +y from +z"),
    "opponent": ("1", "avatar number of the opponent, -2 - k for scripted target k, -1 for none"),
    "type": ("1", "index into the attribute type_names"),
    "team": ("1", "index into the attribute team_names"),
    "policy": ("1", "index into the attribute policy_names"),
    "scale": ("1", "body size over the size of the skeleton"),
    "speed": ("1", "motion frames in a control frame"),
    "girth": ("1", "thickness of trunk and limbs for their length, over the skeleton's"),
    "legs": ("1", "length of thighs and shanks for the size of the body, over the skeleton's"),
    "arms": ("1", "length of upper arms and forearms for the size of the body, over the skeleton's"),
    "tempo": ("1/min", "strikes that the avatar can sustain, NaN for one that never tires"),
    "aggression": ("1", "how readily the avatar strikes, as a factor"),
    "range": ("m", "how much further than others the avatar keeps from its opponent while it rests"),
    "stance": ("1", "which foot leads"),
    "group": ("1", "index into the attribute group_names"),
    "name": ("1", "avatar name"),
    "target": ("m", "position of each scripted target"),
}
EVENT_LABELS = {
    "frame": ("control frames", "time of furthest reach since the first control frame"),
    "attacker": ("1", "avatar number of the attacker"),
    "victim": ("1", "avatar number of the victim, -2 - k for scripted target k, -1 for none"),
    "hand": ("1", "side of the limb, 0 left and 1 right"),
    "point": ("m", "position of the fist or foot"),
    "speed": ("m/s", "highest speed of it before, relative to the pelvis"),
    "landed": ("1", "whether the strike landed"),
    "limb": ("1", "0 left hand, 1 right hand, 2 left foot, 3 right foot"),
    "outcome": ("1", "what became of the strike"),
    "damage": ("1", "what the strike took from the health of its victim, in points"),
    "down": ("1", "whether the strike knocked its victim down"),
}
CAST_FLAGS = {"stance": ("any", *STANCES)}
EVENT_FLAGS = {"outcome": OUTCOMES}
"""Meanings of numbers, from 0 on."""
COORDINATES = ("time", "name")
CAST = {
    "type": "types",
    "team": "teams",
    "policy": "policies",
    "scale": "scales",
    "speed": "speeds",
    "girth": "girths",
    "legs": "legs",
    "arms": "arms",
    "tempo": "tempos",
    "aggression": "aggressions",
    "range": "ranges",
    "stance": "stances",
    "group": "groups",
    "name": "names",
}
LATER_CAST = ("girth", "legs", "arms", "tempo", "aggression", "range", "stance")
"""What older takes do not have of each avatar."""
EVENTS = {
    "frame": "<f4",
    "attacker": "<i4",
    "victim": "<i4",
    "hand": "|u1",
    "point": "<f4",
    "speed": "<f4",
    "landed": "|b1",
    "limb": "|u1",
    "outcome": "|u1",
    "damage": "<f4",
    "down": "|b1",
}
AVATARS_A_CHUNK = 65536
_CHUNK_AVATAR_FRAMES = 1 << 18
"""Avatar-frames of a chunk where the scenario sets no length: 1 MiB of each variable."""
_MOST_AVATAR_FRAMES = 4_000_000
"""Most avatar-frames of as many control frames as were chosen for a chunk."""
EVENTS_A_CHUNK = 32768


def chunk_frames(avatars: int, chosen: int | None = None) -> int:
    """Return how many control frames are a chunk of a take: as many as were chosen, else as are about 1 MiB."""
    if chosen is None:
        return _CHUNK_AVATAR_FRAMES // min(max(avatars, 1), AVATARS_A_CHUNK)
    return max(1, min(chosen, _MOST_AVATAR_FRAMES // max(avatars, 1)))
