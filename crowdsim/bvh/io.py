"""BVH files: reading what every exporter writes, and writing what every reader takes.

``read_bvh`` returns a file as it is (``Bvh``), ``to_clip`` converts it to metres and y up; ``from_clip``,
``write_bvh`` and ``BvhWriter`` go the other way.

How files are read:

* Rotation channels apply in file order, each about the axes as the ones before it left them; every joint has an order
  of its own, of any number of axes.
* A joint's position channels replace its OFFSET, the root's too, wherever they are listed among its channels.
* White space and line ends do not matter, nor does the case of keywords. A name is the rest of the line after ROOT,
  JOINT or End. Text is UTF-8, else Latin-1, or UTF-16 with a byte order mark.
* Numbers may have exponents, and decimal commas.
* A frame time is a rounded or truncated 1 / rate; ``fps`` is that rate.
* A file has at most 1 GiB, lines of at most 1 MiB, 1,000 joints, 1,000 end sites and 12 channels a joint. Names have
  at most 256 bytes. Offsets, positions and angles lie within 1,000,000 of 0; frames beyond that, like those that are
  not finite, are faults.
* With several ROOTs all are read; ``to_clip`` takes the first one, ``people.read_people`` each by itself.

What reading and writing again does not keep:

* Line ends, indentation, spelling of keywords, text encoding and byte order mark (UTF-8 comes out), text after the
  last row.
* End sites come before the joints that hang on the same joint, their order among themselves stays.
* The frame time becomes 1 / fps to ten digits; ``Frames:`` becomes the number of rows.
* Numbers have fixed decimals, six by default; offsets have nine.
* Values that are not finite cannot be written.

A ``Bvh`` keeps its channels. What conversion to a clip and back changes besides: positions and offsets are in
centimetres, y up, by default; every joint has one order ('ZXY' by default) and three rotation channels; angles are
unwrapped, so they may lie beyond 180 degrees, and at gimbal lock they differ while the orientation does not; scale
channels and roots after the first are dropped; joints whose positions do not change have an offset instead; end sites
are called 'Site'.
"""

from crowdsim.bvh.clip import UP_AXES, channel_motion, clip_channels, from_clip, rotate_up, to_clip
from crowdsim.bvh.file import Bvh, snap_rate
from crowdsim.bvh.reader import parse_bvh, read_bvh
from crowdsim.bvh.writer import BvhWriter, format_bvh, format_header, format_motion, write_bvh

__all__ = [
    "UP_AXES",
    "Bvh",
    "BvhWriter",
    "channel_motion",
    "clip_channels",
    "format_bvh",
    "format_header",
    "format_motion",
    "from_clip",
    "parse_bvh",
    "read_bvh",
    "rotate_up",
    "snap_rate",
    "to_clip",
    "write_bvh",
]
