"""Cameras: a file for each kind, which says all that there is to know of it.

The class ``CAMERA`` of a file has the keys of the camera in a scenario as its fields, and plans its view over a whole
take (``scenario.camera.Camera``). Scenarios, ``render``, ``validate`` and documents go through all files of this
package (``scenario.cameras.KINDS``), so that another kind is another file here and nothing else.
"""
