"""Helpers of the tests of control are importable here, too."""

import sys
from pathlib import Path

sys.path.append(str(Path(__file__).parents[1] / "crowd"))
