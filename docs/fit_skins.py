"""Measures the skins of all builds and writes what poses know of them, crowdsim/poses/skins.py.

    python docs/fit_skins.py [--check]

Balls as large as gloves and bare fists are laid onto the skin of each build in poses of the embedded boxer, alone and
struck in a run of ``brawl_30``, out of all skin that is in their way, as many onto what each joint carries. The pieces
of ``outlines.lay_pieces`` are then fitted so that these balls touch them, by least squares in which balls off the
pieces count more than balls in them. Hands are fitted likewise, by balls whose surface goes through the vertices of
gloves and fists. ``--check`` prints how far off the pieces of the package are, and writes nothing.
"""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from scipy.optimize import least_squares
from scipy.spatial import cKDTree

from crowdsim.body.anatomy import GIRTHS, SEXES, Build
from crowdsim.body.skin import Skin, build_skin, pose_skins
from crowdsim.motion import quaternion
from crowdsim.motion.body import HEIGHT, Body, build_body
from crowdsim.motion.kinematics import clip_kinematics
from crowdsim.motion.limbs import hinge_axis
from crowdsim.performer.session import perform
from crowdsim.poses import skins
from crowdsim.poses.capsules import PosedBodies
from crowdsim.poses.outlines import Surface, hand_axes, lay_pieces
from crowdsim.poses.sampler import PoseSampler
from crowdsim.preparation.prepare import load_policies
from crowdsim.runs.runner import run
from crowdsim.scenario.scenario import load_scenario

RADII = (0.0684, 0.042)
"""Radii of gloves and of bare fists [m]."""
POSES, STRUCK, SEED = 60, 90, 2
"""Poses of the boxer alone, and of boxers that are struck in a run, and the seed of that."""
BALLS, ROUNDS, FITTED, STEPS = 120, 8, 5000, 20
"""Balls of either size in each pose, rounds in which they go out of what else is in their way, how many balls pieces
are fitted to, and steps of the fit."""
ROBUST, DEEP, PRIOR, LEAST = 0.01, 1.5, 0.3, 0.02
"""Distance beyond which balls in pieces count less [m], since some lie in creases that no pieces follow; how much more
balls off them count; how much pieces are held where they set out from, and their least radius [m]."""
FIRST = (
    ("pelvis", False, (0.0, -0.003, -0.035, 0.11), (0.0, -0.003, -0.035, 0.11)),
    ("pelvis", True, (0.01, -0.025, -0.045, 0.105), (0.005, -0.01, 0.02, 0.09)),
    ("trunk", True, (0.015, 0.001, 0.0, 0.105), (0.07, 0.01, -0.006, 0.073)),
    ("chest", True, (0.069, -0.02, -0.026, 0.098), (0.01, -0.024, 0.03, 0.06)),
    ("chest", True, (0.045, 0.06, 0.02, 0.045), (0.1, 0.0, -0.01, 0.035)),
    ("shoulders", False, (0.0, -0.01, 0.0, 0.055), (0.0, -0.01, 0.0, 0.055)),
    ("collar", False, (-0.06, -0.03, 0.03, 0.05), (0.0, -0.01, 0.0, 0.06)),
    ("collar", False, (-0.05, 0.04, -0.05, 0.045), (0.0, 0.02, -0.04, 0.045)),
    ("collar", False, (-0.05, -0.05, -0.05, 0.05), (0.0, -0.03, -0.04, 0.045)),
    ("neck", False, (0.0, 0.0, 0.0, 0.06), (0.0, 0.0, 0.0, 0.06)),
    ("head", False, (0.0, -0.031, 0.028, 0.08), (0.0, 0.01, 0.033, 0.078)),
    ("head", True, (0.055, -0.015, 0.003, 0.033), (0.002, 0.019, -0.036, 0.074)),
    ("upper arm", False, (0.0, 0.0, 0.0, 0.061), (0.0, 0.0, 0.0, 0.04)),
)
"""Pieces from which the fit sets out: kind, whether there is one on either side, and its ends: how far to the side,
ahead and up they are, and their radius [m]."""
HAND_BALLS = {
    "gloves": [(0.0, 0.0, 0.0, 0.0684), (-0.04, 0.0, 0.0, 0.065), (-0.075, 0.0, 0.0, 0.06), (-0.11, 0.0, 0.0, 0.052),
               (-0.005, 0.054, -0.028, 0.026), (-0.04, 0.052, -0.028, 0.028)],
    "bare": [(0.0, 0.0, 0.0, 0.042), (-0.035, 0.0, 0.0, 0.04), (-0.075, 0.0, 0.0, 0.032), (-0.115, 0.0, 0.0, 0.027),
             (-0.005, 0.033, -0.028, 0.018), (-0.03, 0.033, -0.028, 0.018)],
}  # fmt: skip
"""Balls from which the fit sets out: how far along the hand, to its front and outwards, and their radius [m]."""
OUT = Path(__file__).parent.parent / "crowdsim/poses/skins.py"


class Boxer(NamedTuple):
    """The embedded boxer in some poses.

    Attributes:
        clip: Its motion.
        body: Its body.
        positions: Of joints in the poses [m]. Shape (F, J, 3).
        rotations: Shape (F, J, 4).
        hinges: Axes about which its elbows bend, in the frames of shoulders. Shape (2, 3).
    """

    clip: Any
    body: Body
    positions: Any
    rotations: Any
    hinges: Any

    def skin(self, build: Build) -> Skin:
        """Return its skin."""
        rotations = self.clip.rotations
        return build_skin(self.clip.skeleton, self.body, build, rotations[:: len(rotations) // POSES])


def perform_boxer() -> Boxer:
    """Return the boxer."""
    clip = perform(60.0, 1)[0].clip
    body = build_body(clip.skeleton)
    positions, rotations = (np.asarray(values, float) for values in clip_kinematics(clip))
    chains = [[body.roles[f"{side}_{role}"] for role in ("shoulder", "elbow", "hand")] for side in ("left", "right")]
    hinges = [
        hinge_axis(positions[:, upper], positions[:, middle], positions[:, end], rotations[:, upper])
        for upper, middle, end in chains
    ]
    some = np.linspace(0, len(positions) - 1, POSES).astype(int)
    struck = struck_rotations()
    places = np.zeros((*struck.shape[:2], 3))
    for joint, parent in enumerate(clip.skeleton.parents):
        if parent >= 0:
            places[:, joint] = places[:, parent] + quaternion.rotate(struck[:, parent], clip.skeleton.offsets[joint])
    return Boxer(clip, body, np.concatenate([positions[some], places]), np.concatenate([rotations[some], struck]),
                 np.array(hinges))  # fmt: skip


def struck_rotations() -> Any:
    """Return rotations of joints of boxers that are struck in a run of brawl_30. Shape (F, J, 4)."""
    scenario = load_scenario("brawl_30").model_copy(update={"seed": SEED})
    policies = load_policies(scenario)
    take = run(scenario, policies)
    strikes = take.strikes(outcome="landed")
    strikes = strikes[strikes["victim"] >= 0]
    strikes = strikes[np.linspace(0, len(strikes) - 1, STRUCK).astype(int)]
    sampler = PoseSampler(take, policies)
    posed = [sampler.moments(strikes["victim"][[row]], strikes["seconds"][[row]])[0] for row in range(len(strikes))]
    return np.concatenate([np.asarray(rotations, float) for _, _, _, _, rotations in posed])


def carriers(skin: Skin) -> Any:
    """Return the joint or helper that each vertex follows most. Shape (V,)."""
    return skin.joints[np.arange(len(skin.joints)), np.argmax(skin.weights, axis=1)]


def lay_balls(boxer: Boxer, skin: Skin, seed: int) -> tuple[Any, Any, Any]:
    """Return the pose, middle [m] and radius [m] of balls that touch the skin of trunk, head or upper arms."""
    rng, found = np.random.default_rng(seed), []
    roles = [boxer.body.roles[f"{side}_{role}"] for side in ("left", "right") for role in ("elbow", "hand", "hip")]
    beyond = np.ones(len(skin.positions), bool)
    for joint, parent in enumerate(skin.parents):
        beyond[joint] = joint in roles or (parent >= 0 and beyond[parent])
    own = carriers(skin)
    joints = np.unique(own[~beyond[own]])
    shown = [np.flatnonzero(own == joint) for joint in joints]
    for pose in range(len(boxer.positions)):
        here = slice(pose, pose + 1)
        matrices = skin.matrices(boxer.positions[here], boxer.rotations[here], np.ones(1))
        (vertices,), (normals,) = pose_skins([skin], matrices)
        tree = cKDTree(vertices)
        for radius in RADII:
            some = np.concatenate([rng.choice(vertices_of, BALLS // len(joints)) for vertices_of in shown])
            start = vertices[some].astype(float) + radius * normals[some]
            middles = start
            for _ in range(ROUNDS):
                far, nearest = tree.query(middles)
                out = (middles - vertices[nearest]) / np.maximum(far, 1e-9)[:, None]
                middles = middles + np.maximum(radius - far, 0.0)[:, None] * out
            far, nearest = tree.query(middles)
            outside = np.sum((middles - vertices[nearest]) * normals[nearest], axis=1) > 0.5 * radius
            touching = (np.abs(far - radius) < 0.0015) & outside & ~beyond[own[nearest]]
            middles = middles[touching & (np.linalg.norm(middles - start, axis=1) < radius)]
            found.append((np.full(len(middles), pose), middles, np.full(len(middles), radius)))
    poses, middles, radii = (np.concatenate(values) for values in zip(*found, strict=True))
    return poses, middles, radii


def gaps(boxer: Boxer, pieces: Any, girth: float, poses: Any, middles: Any, radii: Any) -> Any:
    """Return how far balls are off pieces (P, 2, 4) [m]."""
    count = len(boxer.positions)
    ones = np.ones(count)
    bodies = PosedBodies(boxer.body, np.arange(count), ones, girth * ones, np.ones((count, 3)), boxer.positions[None],
                         boxer.rotations[None])  # fmt: skip
    laid = lay_pieces(bodies, np.broadcast_to(pieces, (count, *pieces.shape)), ones)
    return Surface(*(values[poses] for values in laid)).gaps(middles)[0] - radii


def fit_pieces(boxer: Boxer, first: Any, girth: float, balls: tuple[Any, Any, Any]) -> Any:
    """Return the pieces (P, 2, 4) that balls touch."""
    some = np.random.default_rng(0).choice(len(balls[0]), FITTED, replace=False)
    free = np.ones(first.shape, bool)
    for row, (kind, twice) in enumerate(skins.PIECES):
        free[row, :, 0] = twice or kind == "collar"
        free[row, :, :2] &= kind != "upper arm"
    alike = np.array([kind in skins.ACROSS and not twice for kind, twice in skins.PIECES])
    free[alike, 1] = False

    def whole(numbers: Any) -> Any:
        pieces = first.copy()
        pieces[free] = numbers
        pieces[alike, 1] = pieces[alike, 0]
        return pieces

    def off(numbers: Any) -> Any:
        away = gaps(boxer, whole(numbers), girth, *(values[some] for values in balls)) / ROBUST
        # Fists are in skins where pieces are too small; where these are too large they are off them, which shows less.
        eased = np.where(away > 0.0, DEEP * away, -np.sqrt(np.log1p(away * away)))
        return np.append(eased, PRIOR * (numbers - first[free]) / ROBUST)

    least = np.full(first.shape, -np.inf)
    least[..., 3] = LEAST - 1e-6
    start = np.maximum(first, least + 1e-6)[free]
    found = least_squares(off, start, bounds=(least[free], np.inf), x_scale=0.01, max_nfev=STEPS)
    return whole(found.x)


def hand_gaps(boxer: Boxer, skin: Skin, balls: Any) -> Any:
    """Return how far vertices of a hand are off its balls (B, 4) [m]."""
    body, hand = boxer.body, boxer.body.roles["left_hand"]
    own = skin.vertices[carriers(skin) == hand] - skin.positions[hand]
    own = quaternion.rotate(quaternion.conjugate(skin.rotations[hand]), own) - body.fist_offsets[0]
    points = own @ hand_axes(body, boxer.hinges)[0].T / (body.height / HEIGHT)
    return (np.linalg.norm(points[:, None] - balls[:, :3], axis=2) - balls[:, 3]).min(axis=1)


def fit_hand(boxer: Boxer, skin: Skin, first: Any) -> Any:
    """Return balls (B, 4) whose surface goes through the vertices of a hand; the first, which lands, is given."""

    def whole(numbers: Any) -> Any:
        return np.concatenate([first[:1], numbers.reshape(-1, 4)])

    def off(numbers: Any) -> Any:
        return hand_gaps(boxer, skin, whole(numbers)) / ROBUST

    return whole(least_squares(off, first[1:].ravel(), x_scale=0.01).x)


def shown(off: Any) -> str:
    """Return distances [m] as words."""
    beyond = ", ".join(f"{np.mean(np.abs(off) > 0.01 * far):.1%} by more than {far} cm" for far in (1, 2))
    return f"off by {100.0 * np.median(np.abs(off)):.2f} cm in the median, {beyond}"


def source(numbers: Any) -> str:
    """Return rows of numbers as source."""
    return ", ".join(f"{value:.4f}" for value in np.ravel(numbers))


def write(bodies: dict[str, dict[float, Any]], hands: dict[str, Any]) -> None:
    """Write the module."""
    lines = [HEAD, "PIECES = ("]
    lines += [f'    ("{kind}", {twice}),' for kind, twice, _, _ in FIRST]
    lines += [")", PIECES_TEXT, "# fmt: off", "BODIES = {"]
    for sex, kinds in bodies.items():
        lines.append(f'    "{sex}": {{')
        for girth, pieces in kinds.items():
            lines.append(f"        {girth}: np.array([")
            lines += [f"            {source(piece)}," for piece in pieces]
            lines.append("        ]).reshape(-1, 2, 4),")
        lines.append("    },")
    lines += ["}", BODIES_TEXT, "HAND_BALLS = {"]
    for name, balls in hands.items():
        lines.append(f'    "{name}": np.array([')
        lines += [f"        [{source(ball)}]," for ball in balls]
        lines.append("    ]),")
    lines += ["}", HANDS_TEXT]
    OUT.write_text("\n".join(lines) + "\n")


HEAD = '''"""Skins as pieces: capsules and balls that are fitted to the meshes. Written by docs/fit_skins.py."""

from __future__ import annotations

import numpy as np

ACROSS = ("pelvis", "shoulders")
"""Capsules that lie across a body."""'''
PIECES_TEXT = '''"""Capsule that each piece lies along, and whether there is one on either side. Collars lie from the
ends of the capsule across the shoulders to where arms hang."""'''
BODIES_TEXT = '''"""Pieces by sex and girth, for a man of 1.75 m: how far both ends are to the side, ahead and up from
those of the capsule, and their radius [m]. Shape (P, 2, 4)."""'''
HANDS_TEXT = '''"""Balls of hands: along the hand from the middle of the fist, to its front and outwards, and radius
[m]. The first is what lands. Shape (B, 4)."""
# fmt: on'''


def main() -> None:
    """Read the command line, fit, and write or print."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--check", action="store_true", help="print how far off what the package has is")
    check, boxer = parser.parse_args().check, perform_boxer()
    bodies: dict[str, dict[float, Any]] = {sex: {} for sex in SEXES}
    hands, first = {}, np.array([row[2:] for row in FIRST])
    for sex in SEXES:
        for kind, girth in GIRTHS.items():
            skin = boxer.skin(Build(sex, kind))
            pieces = skins.BODIES[sex][girth] if check else fit_pieces(boxer, first, girth, lay_balls(boxer, skin, 1))
            bodies[sex][girth] = pieces
            print(f"{sex} {kind}: balls {shown(gaps(boxer, pieces, girth, *lay_balls(boxer, skin, 2)))}", flush=True)
    for name, balls in HAND_BALLS.items():
        skin = boxer.skin(Build(hands=name))
        hands[name] = skins.HAND_BALLS[name] if check else fit_hand(boxer, skin, np.array(balls))
        print(f"{name}: vertices {shown(hand_gaps(boxer, skin, hands[name]))}", flush=True)
    if not check:
        write(bodies, hands)


if __name__ == "__main__":
    main()
