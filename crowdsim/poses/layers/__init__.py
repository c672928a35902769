"""The layers of poses, in the order in which they are added; one more is one file here, and its place in this list."""

from __future__ import annotations

from crowdsim.poses.layer import Layer
from crowdsim.poses.layers.blend import Blend
from crowdsim.poses.layers.breathing import Breathing
from crowdsim.poses.layers.deflection import Deflection, SecondDeflection
from crowdsim.poses.layers.feet import Feet
from crowdsim.poses.layers.fists import Fists
from crowdsim.poses.layers.floor import Floor
from crowdsim.poses.layers.gaze import HeadTurns
from crowdsim.poses.layers.hands import Hands
from crowdsim.poses.layers.kicks import Kicks
from crowdsim.poses.layers.pelvis import Lowering
from crowdsim.poses.layers.reaches import Reaches
from crowdsim.poses.layers.reactions import Reactions
from crowdsim.poses.layers.separation import Separation

LAYERS: tuple[type[Layer], ...] = (
    Blend,
    Separation,
    Lowering,
    Feet,
    Hands,
    Floor,
    HeadTurns,
    Breathing,
    Reactions,
    Kicks,
    Reaches,
    Fists,
    Deflection,
    SecondDeflection,
)
