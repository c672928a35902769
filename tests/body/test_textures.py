"""Textures: tiles that repeat, one light in the mean, as large on a skin as they are."""

import io

import numpy as np
import pytest
from PIL import Image

from crowdsim.body.anatomy import Build
from crowdsim.body.parts import SKIN_PARTS
from crowdsim.body.skin import Skin, build_skin
from crowdsim.body.textures import PIXELS, TEXTURES, TILE, texture_light, texture_png
from crowdsim.motion.body import build_body
from crowdsim.performer.session import perform


@pytest.fixture(scope="module")
def skin() -> Skin:
    clip = perform(12.0, 3)[0].clip
    return build_skin(clip.skeleton, build_body(clip.skeleton), Build("female", "lean", "bare"), clip.rotations[::30])


@pytest.mark.parametrize("name", sorted(set(TEXTURES.values())))
def test_a_texture_repeats_without_an_edge_and_keeps_the_colour_in_the_mean(name: str) -> None:
    light = texture_light(name)
    np.testing.assert_allclose(light.mean(axis=(0, 1)), 1.0, atol=1e-9)
    assert np.ptp(light, axis=(0, 1)).min() > 0.05
    for axis in (0, 1):
        steps = np.abs(np.diff(light, axis=axis)).mean(axis=(1 - axis, 2))
        across = np.abs(np.take(light, 0, axis=axis) - np.take(light, -1, axis=axis)).mean()
        assert across <= 1.5 * steps.max()
    data, most = texture_png(name)
    encoded = np.asarray(Image.open(io.BytesIO(data)).convert("RGB")) / 255.0
    assert encoded.shape == (PIXELS, PIXELS, 3)
    linear = np.where(encoded <= 0.04045, encoded / 12.92, ((encoded + 0.055) / 1.055) ** 2.4)
    np.testing.assert_allclose(linear * most, light, atol=0.01)
    assert texture_png(name)[0] == data


def test_textures_lie_on_a_skin_as_large_as_they_are(skin: Skin) -> None:
    assert set(TEXTURES) <= set(SKIN_PARTS)
    assert skin.places.shape == (len(skin.vertices), 2)
    assert skin.places.dtype == np.float32
    for texture in set(TEXTURES.values()):
        worn = np.isin(skin.parts, [SKIN_PARTS.index(part) for part, name in TEXTURES.items() if name == texture])
        edges = np.concatenate([skin.triangles[worn][:, ends] for ends in ([0, 1], [1, 2], [2, 0])])
        apart, shown = (
            np.linalg.norm(np.diff(values[edges], axis=1)[:, 0], axis=1)
            for values in (skin.vertices, TILE * skin.places)
        )
        ratio = shown / np.maximum(apart, 1e-6)
        assert 0.8 < np.median(ratio) < 1.25
        # Where skin goes from one segment to the next it stretches.
        assert (ratio > 2.0).mean() < 0.1
