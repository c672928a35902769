"""Records of what has been learned, as compiled code reads them (``policy.LookupTables``)."""

import numpy as np

BEHAVIOUR = np.dtype(
    [
        ("first_axis", np.int64),
        ("end_axis", np.int64),
        ("first_term", np.int64),
        ("end_term", np.int64),
        ("cells", np.int64),
        ("table", np.int64),
        ("scale", np.float64),
        ("discount", np.float64),
        ("low", np.float64),
        ("step", np.float64),
        ("price", np.float64),
        ("each", np.float64),
        ("lead_now", np.float64),
        ("lead_later", np.float64),
        ("looks_ahead", np.bool_),
        ("further", np.bool_),
    ],
    align=True,
)
"""A behaviour: its rows of axes and terms; cells of its grid, its first entry in the table; scale and discount; what
an entry of 0 is worth, and a step of 1 more; what a transition costs it, for a cost of 1 and for each one; how many
control frames later a moving target is seen by a table of Q, and after an action by one of V
(``environment.Grid.leads``); whether its table is one of V, read behind an action (the look-up v); whether its grid has
axes beside distance, bearing and height. GPUs read nothing that is not aligned."""

AXIS = np.dtype(
    [
        ("kind", np.int64),
        ("first", np.float64),
        ("step", np.float64),
        ("count", np.int64),
        ("wraps", np.bool_),
        ("stride", np.int64),
        ("fade", np.float64),
        ("minimum", np.float64),
        ("maximum", np.float64),
        ("rate", np.float64),
    ]
)
"""An axis of a grid: its kind; first point and step, squeezed (``environment.Axis.rate``); grid points; whether it
closes on itself; how far apart neighbours lie in a table; how far beyond its range a behaviour fades out; its range."""
