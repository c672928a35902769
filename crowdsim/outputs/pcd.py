"""Point clouds of a take as binary PCD, which Open3D writes."""

from crowdsim.export.clouds import CloudOutput


class PcdOutput(CloudOutput):
    """Point clouds as PCD, one file per frame."""

    name = "pcd"
    about = "Point clouds as PCD, one file per frame."

    def prepare(self) -> None:
        """Begin to try Open3D."""
        from crowdsim.export.cloud_files import begin_probe

        begin_probe()


OUTPUT = PcdOutput
