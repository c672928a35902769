"""What a run can write: a file for each output, which says all that there is to know of it.

The class ``OUTPUT`` of a file has the keys of the output in a scenario as its fields, and says which files there are,
what they cost, what is wrong with them and how they are written (``scenario.output.Output``). Scenarios, ``run``,
``export``, ``batch``, ``validate``, manifests and documents go through all files of this package
(``scenario.outputs.REGISTRY``), so that another output is another file here and nothing else. Outputs that are written
from poses build on ``export.posed.PosedOutput``, those of one file an avatar on ``export.avatar_files.AvatarFiles``.
"""
