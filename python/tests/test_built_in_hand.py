"""The built-in hand describes itself once: what plans, draws and measures with it takes its figures from the model."""

import numpy as np

import quasirigid as qr
from quasirigid.scene.built_in_hand import FINGER_SPACING
from quasirigid.scene.palette import LINK_RADII


def test_pads_stand_as_far_apart_as_the_planner_thinks() -> None:
    world = qr.World()
    hand = world.add_hand(points=300, control_points=40, position=(0.1, 0.2, 0.3))
    pads = hand.tip_poses()[0] - np.array([0.1, 0.2, 0.3])
    spacing = pads[1, 1] - pads[2, 1]
    assert abs(spacing - FINGER_SPACING) < 1e-15, f"{spacing} m against {FINGER_SPACING} m"
    assert qr.HandGeometry().finger_spacing == FINGER_SPACING, f"the planner has {qr.HandGeometry().finger_spacing} m"
    assert abs(pads[0, 1]) < 1e-12, f"the thumb stands {pads[0, 1]} m aside"


def test_knuckles_are_where_the_straight_fingers_begin() -> None:
    world = qr.World()
    hand = world.add_hand(points=300, control_points=40)
    knuckles = qr.HandModel.three_finger().knuckles
    first_links = hand.link_poses[:, 0, :3]
    assert np.abs(knuckles - first_links).max() < 1e-15, f"{knuckles} m against {first_links} m"


def test_drawn_fingers_are_as_thick_as_the_links_of_the_model() -> None:
    proximal, middle, distal = qr.HandModel.three_finger_link_radii()
    assert proximal == LINK_RADII[0]
    for k, (near, far) in enumerate([(proximal, middle), (middle, distal)], start=1):
        assert far <= LINK_RADII[k] <= near, f"joint {k} is drawn with {LINK_RADII[k]} m between links of {near} and {far} m"
