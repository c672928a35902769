"""One more value term is one new file and its place in ``evaluate.ADDED``."""

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]

TERM = '''"""Peace: what strikes cost avatars whose numbers are even."""

from crowdsim.crowd.kernels.terms.strikes import weigh_by_strikes
from crowdsim.jit import kernel

PRICE = 1000.0  # in normalised values


@kernel(inline=True)
def keep_peace(model, avatars, world, now, own, observed, q, scratch):
    """Lower the values of actions by ``PRICE`` for each of their strikes."""
    if avatars.number[own] % 2 == 0:
        weigh_by_strikes(model, avatars, own, -PRICE, scratch.values[q])
'''

PROGRAM = """
import numpy as np
from test_tempo import ran
import crowdsim

_, attackers, _ = ran(60)
print(crowdsim.__file__, np.count_nonzero(attackers % 2 == 0), np.count_nonzero(attackers % 2 == 1))
"""


def strikes_of(folder: Path) -> tuple[int, int]:
    """How many strikes avatars with even and with odd numbers throw, by the package in a folder."""
    path = os.pathsep.join(map(str, (folder, ROOT / "tests", ROOT / "tests" / "crowd")))
    done = subprocess.run(
        [sys.executable, "-c", PROGRAM], env={**os.environ, "PYTHONPATH": path}, cwd=folder, text=True,
        capture_output=True, check=True, timeout=600,
    )  # fmt: skip
    package, even, odd = done.stdout.split()
    assert Path(package).is_relative_to(folder)
    return int(even), int(odd)


@pytest.mark.slow
def test_a_term_is_one_file_and_its_place_in_the_list(tmp_path: Path) -> None:
    kernels = tmp_path / "crowdsim" / "crowd" / "kernels"
    shutil.copytree(ROOT / "crowdsim", tmp_path / "crowdsim", ignore=shutil.ignore_patterns("__pycache__"))
    (kernels / "terms" / "peace.py").write_text(TERM, encoding="utf-8")
    text = (kernels / "evaluate.py").read_text(encoding="utf-8")
    first, last = "from crowdsim.crowd.kernels.terms.rest import seek_rest\n", '    ("stance", keep_stance),\n'
    assert first in text
    assert last in text
    text = text.replace(first, "from crowdsim.crowd.kernels.terms.peace import keep_peace\n" + first)
    (kernels / "evaluate.py").write_text(text.replace(last, '    ("peace", keep_peace),\n' + last), encoding="utf-8")
    even, odd = strikes_of(tmp_path)
    usual, _ = strikes_of(ROOT)
    assert usual > 20
    assert odd > 20
    assert even == 0
