"""Views: where the eye is, what a section cuts off, and the names of shots."""

import numpy as np
import pytest
from support.modules import displaced

from taichi_ldem.errors import SceneError
from taichi_ldem.output.render.views import VIEWS, Shot, parse_section, view_of


@pytest.mark.parametrize(
    ("view", "towards_eye", "right"),
    [("below", (0, 0, -1), (-1, 0, 0)), ("cut", (0, -1, 0), (1, 0, 0))],
)
def test_views_look_where_they_say(view, towards_eye, right):
    for panel in VIEWS[view](np.array((0.09, 0.09, 0.003))).panels:
        np.testing.assert_allclose(panel.rotation[2], towards_eye, atol=1e-12)
        np.testing.assert_allclose(panel.rotation[0], right, atol=1e-12)
        np.testing.assert_allclose(panel.rotation @ panel.rotation.T, np.eye(3), atol=1e-12)


@pytest.mark.parametrize(
    ("view", "section", "kept"),
    [
        ("above", ("y", 0.5), [False, False, True, True]),  # the eye is at -y
        ("above", ("x", 0.5), [True, False, True, False]),  # and at +x
        ("above", ("z", 0.6), [True, True, True, True]),
        ("below", ("z", 0.6), [False, False, False, False]),
    ],
)
def test_what_lies_before_the_section_is_not_drawn(view, section, kept) -> None:
    fields = displaced(np.zeros((3, 3)), (0, 0, 0))
    shot = Shot(view=view, section=section)
    assert view_of(shot, np.array((1.0, 1.0, 0.5))).part(fields).tolist() == kept


@pytest.mark.parametrize("text", ["y", "y=", "w=1", "y=nan", "y=one"])
def test_a_section_that_is_none_is_refused(text: str) -> None:
    with pytest.raises(SceneError, match="--section"):
        parse_section(text)


def test_pictures_of_other_shots_have_other_names():
    shots = [
        Shot(view="above"),
        Shot(view="above", section=("x", 0.0)),
        Shot(view="above", section=("x", 2e-3)),
        Shot(azimuth=25.0, elevation=-35.0),
        Shot(colour="energy"),
    ]
    names = [shot.name for shot in shots]
    assert names == ["above", "above_x0", "above_x0.002", "below_az25_el-35", "below_energy"]
