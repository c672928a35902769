"""Point clouds of a take as binary PLY."""

from crowdsim.export.clouds import CloudOutput


class PlyOutput(CloudOutput):
    """Point clouds as PLY, one file per frame."""

    name = "ply"
    about = "Point clouds as PLY, one file per frame."


OUTPUT = PlyOutput
