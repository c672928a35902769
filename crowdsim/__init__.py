"""crowdsim: data-driven fight crowds, motion capture in, a trained crowd out.

Conventions, said here once; every module keeps them:

* Metres, seconds, radians. Files in other units are converted at the BVH border and nowhere else.
* Right-handed, y up, the floor at y = 0. An avatar at heading 0 faces +z; heading is the turn about +y, so that the
  facing direction is ``(sin(heading), 0, cos(heading))``.
* Quaternions are arrays ``(..., 4)`` in the order w, x, y, z. A joint's rotation is local: it turns the joint's frame
  in its parent's. Euler angles are intrinsic, in a file's own channel order, per joint.
* The root's parent is -1, and parents come before their children.
* Arrays lead with (frame), (avatar) or (action) and end with the component.
* A *ground transform* is ``(x, z, heading)``: the position and heading of a body.
* *Control frames* are the frames of decisions (15 Hz by default); *playback frames* are those of poses (60 Hz).
  Playback frame ``p`` of a motion database lies at control frame ``p / stride``.
* Hands and feet are ordered left, right: index 0 is left and 1 is right.
"""

from importlib import import_module
from typing import Any

from crowdsim.jit.environment import choose_kernel_cache

__version__ = "0.1.0"

_LAZY = {
    "BvhError": "crowdsim.errors",
    "CrowdsimError": "crowdsim.errors",
    "PolicyError": "crowdsim.errors",
    "RecipeError": "crowdsim.errors",
    "RunError": "crowdsim.errors",
    "ScenarioError": "crowdsim.errors",
    "Simulation": "crowdsim.crowd.simulation",
    "TakeError": "crowdsim.errors",
    "PoseSampler": "crowdsim.poses.sampler",
    "build_scenario": "crowdsim.scenario.scenario",
    "draw_crowd": "crowdsim.crowd.draw",
    "export_bvh": "crowdsim.outputs.bvh",
    "export_clouds": "crowdsim.export.pointcloud",
    "load_policies": "crowdsim.preparation.prepare",
    "load_policy": "crowdsim.policy.bundle",
    "load_recipe": "crowdsim.training.recipe",
    "load_scenario": "crowdsim.scenario.scenario",
    "open_batch": "crowdsim.batch.dataset",
    "open_run": "crowdsim.runs.opening",
    "open_take": "crowdsim.take.store",
    "read_bvh": "crowdsim.bvh.io",
    "run": "crowdsim.runs.runner",
    "run_to": "crowdsim.runs.runner",
    "to_clip": "crowdsim.bvh.io",
    "train_recipe": "crowdsim.self_play.train",
    "write_bvh": "crowdsim.bvh.io",
}

__all__ = ["__version__", *sorted(_LAZY)]


choose_kernel_cache()


def __getattr__(name: str) -> Any:
    """Import a public name on first use, so that importing the package stays light."""
    if name in _LAZY:
        return getattr(import_module(_LAZY[name]), name)
    raise AttributeError(f"module 'crowdsim' has no attribute {name!r}; it has {', '.join(__all__)}")


def __dir__() -> list[str]:
    return list(__all__)
