"""Kinds of faults that capture has, a file each, and the order in which they are looked for.

Each kind examines a reading and returns what is wrong with it; its repair returns another reading, which the next kind
examines. What makes nonsense of positions comes first, what only shows in sound motion last.
"""

from crowdsim.capture.faults.angles import Angles
from crowdsim.capture.faults.channels import Channels
from crowdsim.capture.faults.diagnosis import Action, Choice, Diagnosis, Fault
from crowdsim.capture.faults.elbows import Elbows
from crowdsim.capture.faults.ends import Ends
from crowdsim.capture.faults.floor import Floor
from crowdsim.capture.faults.handedness import Handedness, Knees
from crowdsim.capture.faults.in_place import InPlace
from crowdsim.capture.faults.limbs import Limbs
from crowdsim.capture.faults.pose_jumps import PoseJumps
from crowdsim.capture.faults.repeats import Repeats
from crowdsim.capture.faults.root_drift import RootDrift
from crowdsim.capture.faults.root_held import RootHeld
from crowdsim.capture.faults.root_jumps import RootJumps
from crowdsim.capture.faults.root_path import RootPath
from crowdsim.capture.faults.rotations import Rotations
from crowdsim.capture.faults.sides import Sides
from crowdsim.capture.faults.spins import Spins
from crowdsim.capture.faults.tilt import Tilt
from crowdsim.capture.faults.time_base import TimeBase

FAULTS: tuple[Fault, ...] = (
    Repeats(),
    Channels(),
    Sides(),
    Angles(),
    Rotations(),
    TimeBase(),
    Spins(),
    RootHeld(),
    RootPath(),
    Ends(),
    Limbs(),
    RootJumps(),
    PoseJumps(),
    InPlace(),
    RootDrift(),
    Handedness(),
    Knees(),
    Tilt(),
    Floor(),
    Elbows(),
)

__all__ = ["FAULTS", "Action", "Choice", "Diagnosis", "Fault"]
