"""How the embedded boxer stands: drawn once a clip, so that clips differ as rounds of one man do."""

from __future__ import annotations

import numpy as np

from crowdsim.performer.score import Style


def draw_style(rng: np.random.Generator) -> Style:
    """Draw how the boxer of one clip stands."""

    def near(middle: float, spread: float) -> float:
        return middle + float(rng.uniform(-spread, spread))

    wide = near(1.03, 0.025)
    return Style(
        lead_ball=(near(0.10 * wide, 0.007), 0.25 * wide),
        rear_ball=(near(-0.12 * wide, 0.007), -0.21 * wide),
        foot_yaws=(near(-0.28, 0.05), near(-0.80, 0.06)),
        heels=(near(0.08, 0.02), near(0.27, 0.05)),
        height=near(0.885, 0.010),
        lean=near(0.26, 0.03),
        blade=near(-0.55, 0.04),
        twist=near(-0.06, 0.03),
        lead_fist=(near(0.10, 0.016), near(0.22, 0.022), near(0.37, 0.02)),
        rear_fist=(near(-0.06, 0.010), near(0.215, 0.016), near(0.27, 0.013)),
        elbows=(near(0.10, 0.08), near(0.12, 0.08)),
        bounce=(near(0.010, 0.004), near(2.0, 0.3)),
        sway=near(0.042, 0.008),
        breath=near(0.46, 0.08),
    )
