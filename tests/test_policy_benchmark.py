"""The benchmark of policies: the reward of a composition, and a quick run."""

import importlib
import json
import math
import subprocess
import sys
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest

from crowdsim.policy.environment import Axis, build_grid
from crowdsim.policy.evaluation import Composition
from crowdsim.policy.policy import Behaviour, Policy
from crowdsim.policy.recipe import Recipe
from crowdsim.policy.rewards import TargetBody, TransitionTerm, action_reward

sys.path.insert(0, str(Path(__file__).parent / "policy"))
