"""Statistics of Table 3, and its printed data."""

import numpy as np
import pytest

import truepose as tp
from truepose.robot import workspace_grid
from truepose.simulation.paths import MOVE_DURATION, MOVE_FROM, MOVE_TO
from truepose_paper import article, experiment


def test_table_3_by_hand():
    """Three poses, errors chosen so that every statistic can be done in the head."""
    error = [[3, 0, 4, -1], [-3, 0, 4, 2], [0, 6, 0, 2]]
    assert experiment.table3(error) == pytest.approx(
        np.array(
            [
                # average, peak to peak, sum of squares, average of absolute values
                [0, 6, 18, 2],  # x
                [2, 6, 36, 2],  # y
                [8 / 3, 4, 32, 8 / 3],  # z
                [1, 3, 9, 5 / 3],  # θ: the sign counts in the average only
                [16 / 3, 1, 86, 16 / 3],  # norms 5, 5, 6
            ]
        )
    )


def test_table_3_of_many_robots_is_that_of_each(rng):
    errors = rng.normal(size=(3, 10, 4))
    tables = experiment.table3(errors)
    assert tables.shape == (3, 5, 4)
    assert np.array_equal(tables[1], experiment.table3(errors[1]))


@pytest.mark.parametrize("shape", [(4,), (10, 3), (0, 4)])
def test_table_3_needs_poses_of_four_errors(shape):
    with pytest.raises(tp.InputError, match=r"^error: shape .*, must be \(..., poses, 4\)$"):
        experiment.table3(np.zeros(shape))


def test_errors_are_printed_in_millimetres_and_degrees():
    assert experiment.in_print_units([1e-3, 0, -2e-3, np.pi]) == pytest.approx([1, 0, -2, 180])


def test_table_2_is_the_box_of_625_poses_in_metres_and_the_nacelles_angle(table2):
    assert table2.shape == (625, 4) and len(np.unique(table2, axis=0)) == 625
    assert table2.min(axis=0) == pytest.approx([-0.1, -0.1, -0.45, -np.pi / 6])
    assert table2.max(axis=0) == pytest.approx([0.1, 0.1, -0.35, np.pi / 6])
    for coordinate, step in zip(table2.T, (0.05, 0.05, 0.025, np.pi / 12), strict=True):
        assert np.diff(np.unique(coordinate.round(9))) == pytest.approx([step] * 4)


def test_the_robot_files_workspace_is_table_2(h4, table2):
    assert table2.min(axis=0) == pytest.approx(h4.spec.workspace.minimum)
    assert table2.max(axis=0) == pytest.approx(h4.spec.workspace.maximum)
    assert np.isfinite(h4.ikm(table2)).all()


@pytest.mark.parametrize(
    ("law", "quantity", "statistic", "printed"),
    [
        ("usual", "x", "average", 2.4),
        ("redundant", "y", "sum_sq", 23100),
        ("usual", "theta", "peak_to_peak", 3.31),
        ("redundant", "theta", "sum_sq", 128),
        ("redundant", "norm_xyz", "average", 8.2),
        ("usual", "z", "average_abs", 3.9),
    ],
)
def test_table_3_is_as_printed(law, quantity, statistic, printed):
    assert article.table3()[law][quantity, statistic] == printed


def test_the_published_scatter_of_theta_is_what_the_derivation_says():
    """The bias falls 16-fold, the scatter only from 0.517° to 0.452°: noise the encoder misses."""
    scatter, bias = {}, {}
    for law, table in article.table3().items():
        bias[law] = table["theta", "average"]
        scatter[law] = np.sqrt(table["theta", "sum_sq"] / 625 - bias[law] ** 2)
    assert scatter["usual"] == pytest.approx(0.517, abs=1e-3)
    assert scatter["redundant"] == pytest.approx(0.452, abs=1e-3)
    assert abs(bias["usual"] / bias["redundant"]) == pytest.approx(16)


def test_the_move_is_that_of_figures_11_to_13():
    assert MOVE_FROM == (0, 0, -0.5, 0)
    assert MOVE_TO == (0.1, -0.1, -0.4, 0.2)
    assert MOVE_DURATION == 0.2


def test_table_2_is_the_grid_of_the_h4s_workspace(h4):
    assert workspace_grid(h4) == pytest.approx(article.table2())
