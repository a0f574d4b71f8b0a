"""Assembly modes of given motor positions, and completeness of the search."""

import numpy as np
import pytest
from fixtures import refused

import truepose as tp


def pose_of(robot):
    return np.clip(
        robot.home + 0.02 * np.arange(1, robot.n + 1),
        robot.spec.workspace.minimum,
        robot.spec.workspace.maximum,
    )


def test_every_mode_closes_on_the_same_motors_and_the_robots_own_is_among_them(chained_robot):
    x = pose_of(chained_robot)
    q = chained_robot.ikm(x)
    modes = chained_robot.assembly_modes(q, starts=500)
    assert len(modes) >= 1 + (chained_robot.m == chained_robot.n)
    assert np.abs(modes.x - x).max(axis=1).min() < 1e-9
    points = [
        chained_robot.skeleton(x)[:, 1]
    ]  # B follows from q alone: every A at rod's length of it
    for mode in modes:
        try:
            skeleton = chained_robot.skeleton(mode)
        except tp.PoseError:  # its own working mode cannot reach there
            continue
        rods = np.linalg.norm(skeleton[:, 1] - skeleton[:, 2], axis=1)
        drawn = np.linalg.norm(points[0] - chained_robot.skeleton(x)[:, 2], axis=1)
        assert rods == pytest.approx(drawn, abs=1e-9)


def test_a_five_bars_two_modes_are_the_meets_of_two_circles():
    robot = tp.load("five-bar")
    x = pose_of(robot)
    modes = robot.assembly_modes(robot.ikm(x)).x
    (_, B1, A1, _), (_, B2, A2, _) = robot.skeleton(x)
    middle, across = (B1 + B2) / 2, (B2 - B1) / np.linalg.norm(B2 - B1)
    assert np.allclose(A1, A2)  # one tool point
    mirrored = A1 - 2 * ((A1 - middle) - ((A1 - middle) @ across) * across)
    offset = A1[:2] - x
    expected = np.array([x, mirrored[:2] - offset])
    assert len(modes) == 2
    assert np.abs(modes[:, None] - expected).max(axis=2).min(axis=1).max() < 1e-9


def test_a_hexapods_modes_come_in_mirror_images():
    robot = tp.load("stewart")
    modes = robot.assembly_modes(robot.ikm(pose_of(robot))).x
    mirror = modes * [1, 1, -1, -1, -1, 1]
    assert len(modes) % 2 == 0
    assert np.abs(modes[:, None] - mirror).max(axis=2).min(axis=1).max() < 1e-6


def test_a_height_leaves_one_mode_of_a_five_bar_and_of_a_hexapod(tmp_path):
    five_bar = tmp_path / "five-bar.toml"
    five_bar.write_text(
        'based_on = "five-bar"\nsensors = ["height"]\n'
        '[[sensor]]\nname = "height"\nkind = "coordinate"\ndirection = [0.0, 1.0, 0.0]\n'
    )
    for robot, away, count in (
        (tp.load(five_bar), [0.03, 0.02], 2),
        (tp.load("stewart").with_sensors("z_telemeter"), [0.02, 0.04, 0.05, 0.1, 0.15, 0.2], 8),
    ):
        x = robot.home + away
        modes = robot.assembly_modes(robot.ikm(x))
        off = np.abs(robot.rkm(modes.x) - robot.rkm(x)).max(axis=1)
        assert len(modes) == count and (off < 1e-3).sum() == 1
        assert modes.unseen == 0.0 and modes.expected == count and modes.seen.min() > 1000


def test_the_search_repeats_itself_and_refuses_what_it_cannot_search():
    robot = tp.load("3rpr")
    q = robot.ikm(robot.home)
    one, two = robot.assembly_modes(q), robot.assembly_modes(q)
    assert np.array_equal(one.x, two.x) and np.array_equal(one.seen, two.seen)
    none = robot.assembly_modes(q + 100)
    assert none.x.shape == (0, 3) and (len(none), none.unseen, none.expected) == (0, 0, 0)
    for bad, word in ((q[:2], "shape"), (q * np.nan, "finite"), ([q, q], "shape")):
        with refused(word):
            robot.assembly_modes(bad)
    for bad in ({"starts": 0}, {"starts": 2_000_000}, {"seed": -1}):
        with refused(next(iter(bad))):
            robot.assembly_modes(q, **bad)


def robot_of(tmp_path, mobility, home, base, nacelle, more=""):
    """Return a robot of telescopic legs, all joints given; without a workspace."""
    legs = [
        f'[[chain]]\nactuator = "telescopic"\nbase = {b}\nanchor = {a}\n'
        for b, a in zip(base, nacelle, strict=True)
    ]
    path = tmp_path / "robot.toml"
    head = f'name = "legs"\nmobility = "{mobility}"\nhome = {[float(c) for c in home]}\n'
    path.write_text(head + more + "".join(legs), encoding="utf-8")
    return tp.load(path)


# P. Dietmaier, The Stewart-Gough platform of general geometry can have 40 real postures, Advances
# in Robot Kinematics: Analysis and Control, 1998: joints on base and platform, lengths of the legs.
DIETMAIER = {
    "base": [
        [0.0, 0.0, 0.0],
        [1.107915, 0.0, 0.0],
        [0.549094, 0.756063, 0.0],
        [0.735077, -0.223935, 0.525991],
        [0.514188, -0.526063, -0.368418],
        [0.590473, 0.094733, -0.205018],
    ],
    "nacelle": [
        [0.0, 0.0, 0.0],
        [0.542805, 0.0, 0.0],
        [0.956919, -0.528915, 0.0],
        [0.665885, -0.353482, 1.402538],
        [0.478359, 1.158742, 0.107672],
        [-0.137087, -0.235121, 0.353913],
    ],
}
LEGS = [1.0, 0.645275, 1.086284, 1.503439, 1.281933, 0.771071]
# A 3-RPR whose six postures, the roots of a polynomial of degree six, are all real.
THREE_RPR = {
    "base": [[0.0, 0.0, 0.0], [1.591, 0.0, 0.0], [0.0, 1.0, 0.0]],
    "nacelle": [[0.0, 0.0, 0.0], [1.704, 0.0, 0.0], [1.32364, 1.60967, 0.0]],
}


@pytest.fixture
def dietmaier(tmp_path):
    return robot_of(tmp_path, "spatial", [0.5, 0, 0.5, 0.1, 0.2, 0.3], **DIETMAIER)


def turned(w, c):
    """Turn c by the rotation vector w (Rodrigues)."""
    angle = np.linalg.norm(w)
    u = w / angle
    return c * np.cos(angle) + np.cross(u, c) * np.sin(angle) + u * (u @ c) * (1 - np.cos(angle))


@pytest.mark.parametrize("seed", [0, 1, 2])
def test_all_40_of_dietmaiers_postures_are_found_at_the_default(dietmaier, seed):
    modes = dietmaier.assembly_modes(LEGS, seed=seed)
    assert len(modes) == 40 == modes.expected and modes.unseen == 0
    for x in modes:
        for b, c, length in zip(*map(np.array, (*DIETMAIER.values(), LEGS)), strict=True):
            assert np.linalg.norm(x[:3] + turned(x[3:], c) - b) == pytest.approx(length, abs=1e-12)
    apart = np.abs(modes.x[:, None] - modes.x).max(axis=2) + np.eye(40)
    assert apart.min() > 1e-4


@pytest.mark.parametrize(
    ("mobility", "joints", "legs", "count"),
    [("spatial", DIETMAIER, LEGS, 40), ("planar", THREE_RPR, [1.498, 1.538, 1.2], 6)],
)
def test_fkm_finds_every_posture_from_1_mm_and_1_mrad_away(tmp_path, mobility, joints, legs, count):
    modes = robot_of(tmp_path, mobility, [0.5] * len(legs), **joints).assembly_modes(legs)
    assert len(modes) == count
    for x in modes:
        own = robot_of(tmp_path, mobility, x, **joints)
        assert own.fkm(legs, x + 1e-3) == pytest.approx(x, abs=1e-9)


def test_a_search_that_is_too_short_says_that_modes_are_missing(dietmaier):
    short = [dietmaier.assembly_modes(LEGS, starts=100, seed=seed) for seed in range(30)]
    found = np.array([len(modes) for modes in short])
    told = np.array([modes.expected for modes in short])
    assert (found < 40).all()
    assert (told >= found).all() and (told > found).mean() > 0.8
    assert abs(np.mean(told) - 40) < 0.7 * (40 - np.mean(found))
    for modes in short:
        assert 0 < modes.unseen < 1


def test_the_workspace_box_plays_no_part(tmp_path, dietmaier):
    boxes = "[workspace]\nminimum = [5, 5, 5, 0, 0, 0]\nmaximum = [6, 6, 6, 1, 1, 1]\n"
    elsewhere = robot_of(tmp_path, "spatial", dietmaier.home, **DIETMAIER, more=boxes)
    modes = [robot.assembly_modes(LEGS, starts=500) for robot in (dietmaier, elsewhere)]
    assert np.array_equal(modes[0].x, modes[1].x)


def test_a_cuspidal_robot_goes_from_mode_to_mode_without_a_singular_pose(tmp_path):
    """C. Innocenti and V. Parenti-Castelli's 3-RPR (1992; here in tens of their unit).

    Two modes of the same legs, and on the straight line between them det J_x keeps its sign: what
    moves along it is never held by fewer than three legs.
    """
    x2, y2 = 0.38036, 1.60967  # the third joint: 1.654 and 2.084 from the others
    nacelle = [*THREE_RPR["nacelle"][:2], [x2, y2, 0.0]]
    start = np.array([-0.201, 1.372, -1.213])
    robot = robot_of(tmp_path, "planar", start, THREE_RPR["base"], nacelle)
    modes = robot.assembly_modes(robot.ikm(start))
    assert len(modes) >= 4 and np.abs(modes.x[0] - start).max() < 1e-9
    end = modes.x[np.argmin(np.abs(modes.x[:, :2] - [-1.139, -0.790]).sum(axis=1))]
    assert robot.ikm(end) == pytest.approx(robot.ikm(start), abs=1e-9)
    assert np.abs(end - start).max() > 1
    way = start + np.linspace(0, 1, 2000)[:, None] * (end - start)
    determinants = np.linalg.det(robot.jacobian(way))  # of J_x⁻¹ J_q, and det J_q keeps its sign
    assert (np.sign(determinants) == np.sign(determinants[0])).all()
    assert robot.conditioning(way).parallel.min() > 0.1
    assert robot.ikm(way).min() > 0.3
    assert np.isfinite(robot.ikm(way, own_mode=True)).all()  # one sign: no mode is lost
