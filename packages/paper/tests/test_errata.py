"""The paper's formulas against truepose's kinematics, and their misprints.

`PaperH4` is a model of the H4 written from the paper's equations alone, in its notation; it shares
no code with truepose. The errata are numbered as in docs/paper.md.
"""

from dataclasses import dataclass

import numpy as np
import pytest

import truepose as tp
from truepose_paper import article, experiment, with_paper_errors

ALPHA = np.array([0, np.pi, 3 * np.pi / 2, 3 * np.pi / 2])
X, Y, Z = np.eye(3)
H = 0.06


@dataclass
class PaperH4:
    """The paper's H4. Fields, one value per chain: l arm, L rod, P motor, a lateral bar."""

    l: np.ndarray
    L: np.ndarray
    P: np.ndarray
    a: np.ndarray

    u = np.array([Y, -Y, X, X])
    E = np.stack([np.cos(ALPHA), np.sin(ALPHA), 0 * ALPHA], axis=1)

    def n(self, x):
        """From D to the pivot that carries the chain: C1 carries 1 and 4, C2 carries 2 and 3."""
        pivot = H * np.array([np.cos(x[3]), np.sin(x[3]), 0])
        return np.array([pivot, -pivot, -pivot, pivot])

    def PA(self, x):
        return x[:3] + self.n(x) + self.a - self.P

    def MNG(self, x):
        """M cos q + N sin q = G."""
        d = self.PA(x)
        M = 2 * self.l * (d * self.E).sum(axis=1)
        N = -2 * self.l * d[:, 2]
        return M, N, (d**2).sum(axis=1) + self.l**2 - self.L**2

    def q(self, x):
        M, N, G = self.MNG(x)
        return np.arctan2(N, M) - np.arccos(G / np.sqrt(M**2 + N**2))  # arms outside

    def p(self, q):
        """Arm P B; q > 0 lowers it."""
        return self.l[:, None] * (np.cos(q)[:, None] * self.E - np.sin(q)[:, None] * Z)

    def jacobians(self, x, u=None, n=None):
        p, n = self.p(self.q(x)), self.n(x) if n is None else n
        v = p - self.PA(x)  # from A to B
        Jx = np.column_stack([v, np.cross(n, v)[:, 2]])
        return Jx, np.diag((np.cross(p, v) * (self.u if u is None else u)).sum(axis=1))

    def J(self, x, **misprint):
        Jx, Jq = self.jacobians(x, **misprint)
        return np.linalg.solve(Jx, Jq)

    def J_by_differences(self, x, h=1e-6):
        rows = [(self.q(x + step) - self.q(x - step)) / (2 * h) for step in h * np.eye(4)]
        return np.linalg.inv(np.transpose(rows))


def same_robot(robot: tp.Robot) -> PaperH4:
    value = {name: parameter.value for name, parameter in robot.parameters.items()}
    chains = [f"chain{i}" for i in range(1, 5)]
    return PaperH4(
        l=np.array([value[f"{c}.arm"] for c in chains]),
        L=np.array([value[f"{c}.rod"] for c in chains]),
        P=np.array([[value[f"{c}.base.{k}"] for k in "xyz"] for c in chains]),
        a=np.array([[value[f"{c}.anchor.{k}"] for k in "xyz"] for c in chains]),
    )


@pytest.fixture(scope="module")
def paper(h4) -> PaperH4:
    return same_robot(h4)


@pytest.mark.parametrize("name", ["h4", "truth"])
def test_the_papers_formulas_give_the_same_motors_and_jacobian(name, request, table2):
    robot = request.getfixturevalue(name)
    model = same_robot(robot)
    assert np.abs(np.array([model.q(x) for x in table2]) - robot.ikm(table2)).max() < 1e-13
    J = np.array([model.J(x) for x in table2])
    assert np.abs(J - robot.jacobian(table2)).max() < 1e-12 * np.abs(J).max()


def test_the_half_angle_form_gives_the_same_motors(paper, table2):
    """t = tan(q/2) solves (G + M) t² - 2 N t + (G - M) = 0."""
    for x in table2[::7]:
        M, N, G = paper.MNG(x)
        t = (N - np.sqrt(N**2 + M**2 - G**2)) / (G + M)
        assert 2 * np.arctan(t) == pytest.approx(paper.q(x), abs=1e-13)


def test_erratum_1_the_second_entry_of_jq_takes_u2_which_is_minus_uy(paper, table2):
    printed = np.array([Y, Y, X, X])
    for x in table2[::50]:
        truth = paper.J_by_differences(x)
        assert np.abs(paper.J(x) - truth).max() < 1e-7 * np.abs(truth).max()
        wrong = paper.J(x, u=printed)
        assert wrong[:, 1] == pytest.approx(-truth[:, 1], abs=1e-7)
        assert np.abs(wrong[:, 1] - truth[:, 1]).max() > 0.05


def test_erratum_2_there_are_two_pivots_not_four_vectors_n(paper, table2):
    for x in table2[::50]:
        truth, two = paper.J_by_differences(x), paper.n(x)
        assert np.array_equal(two[[0, 1]], two[[3, 2]])  # C1 carries 1 and 4, C2 carries 2 and 3
        four = two + paper.a  # from D to each A_i, as n_1 … n_4 would suggest
        assert np.abs(paper.J(x, n=two) - truth).max() < 1e-7 * np.abs(truth).max()
        assert np.abs(paper.J(x, n=four) - truth).max() > 0.01 * np.abs(truth).max()


def closure_error(paper: PaperH4, x, q):
    """Length of every rod when the arms stand at q, less what it is."""
    return np.linalg.norm(paper.p(q) - paper.PA(x), axis=1) - paper.L


def test_erratum_3_the_arctangent_needs_its_quadrant(paper, table2):
    """M < 0 wherever A hangs nearer the middle than P: at every pose of Table 2, every chain."""
    home = np.array([0, 0, -0.4, 0])
    for x in [home, *table2]:
        M, N, G = paper.MNG(x)
        beta = np.arccos(G / np.sqrt(M**2 + N**2))
        right, wrong = np.arctan2(N, M) - beta, np.arctan(N / M) - beta
        assert (M < 0).all()
        assert np.abs(closure_error(paper, x, right)).max() < 1e-14
        assert paper.p(wrong) == pytest.approx(-paper.p(right), abs=1e-14)  # arm turned by π
    M, N, G = paper.MNG(home)
    wrong = np.arctan(N / M) - np.arccos(G / np.sqrt(M**2 + N**2))
    assert np.abs(closure_error(paper, home, wrong)).min() > 0.03  # m


def test_erratum_3_the_cosine_of_beta_divides_by_the_root(paper, table2):
    """G/M, as printed, is no cosine of an angle that closes the loop (often no cosine at all)."""
    closes = 0
    for x in table2[::25]:
        M, N, G = paper.MNG(x)
        beta = np.arccos(np.clip(G / M, -1, 1))
        closes += np.sum(np.abs(closure_error(paper, x, np.arctan2(N, M) - beta)) < 1e-3)
    assert closes == 0


def test_erratum_3_t_is_the_tangent_of_half_the_motors_angle(paper):
    x = np.array([0.05, -0.05, -0.4, 0.3])
    M, N, G = paper.MNG(x)

    def polynomial(t):
        return (G + M) * t**2 - 2 * N * t + (G - M)

    assert np.abs(polynomial(np.tan(paper.q(x) / 2))).max() < 1e-15
    assert np.abs(polynomial(np.tan(x[3] / 2))).min() > 1e-3


def test_erratum_4_l_is_the_arm_and_L_the_rod(h4, paper, table2):
    """The text calls L_i arms and l_i fore arms; the equations, and truepose, the reverse."""
    for x, q in zip(table2[::50], h4.ikm(table2[::50]), strict=True):
        arm = paper.p(q)
        assert np.linalg.norm(arm, axis=1) == pytest.approx([0.26] * 4)
        assert np.linalg.norm(arm - paper.PA(x), axis=1) == pytest.approx([0.48] * 4)
    drawn = [with_paper_errors(h4, seed) for seed in range(50)]
    rods, arms = (
        np.array([t.parameters[f"chain{i}.{part}"].value for t in drawn for i in range(1, 5)])
        for part in ("rod", "arm")
    )
    assert -3e-3 <= (rods - 0.48).min() < -2e-3 and 9e-3 < (rods - 0.48).max() <= 10e-3
    assert (arms - 0.26).min() >= -0.4e-3 and (arms - 0.26).max() <= 0.6e-3


def with_theta_weight(robot: tp.Robot, weight: float) -> tp.Robot:
    theta, *others = robot.spec.sensor
    sensors = (theta.model_copy(update={"weight": weight}), *others)
    return tp.Robot(robot.spec.model_copy(update={"sensor": sensors}))


def test_erratum_5_the_last_row_of_m_is_for_theta_and_for_4_theta_its_weight_would_be_16(
    h4, table2
):
    M, M_plus = h4.tej(table2)
    assert np.abs(M[:, 4] - h4.jacobian(table2)[:, 3]).max() < 1e-14
    tool, tool_plus = h4.replace({"theta.gain": 4.0}).tej(table2)
    _, weighted = with_theta_weight(h4, 16).tej(table2)
    assert np.abs(tool[:, 4] - 4 * M[:, 4]).max() < 1e-13
    scale = np.array([1, 1, 1, 1, 4])  # an error of θ counts four times as an error of 4θ
    assert np.abs(tool_plus * scale - weighted).max() < 1e-13
    assert np.abs(tool_plus * scale - M_plus).max() > 1e-3


def test_erratum_7_thetas_quadratic_error_is_in_square_degrees(rng):
    """Table 3 prints mm² for every row. θ's only agrees with its other columns as deg²."""
    for law in ("usual", "redundant"):
        theta = {s: article.table3()[law]["theta", s] for s in article.STATISTICS}
        # The mean square is between the squares of the mean and of the peak: same unit, squared.
        mean_square = theta["sum_sq"] / 625
        assert theta["average"] ** 2 < mean_square < theta["peak_to_peak"] ** 2
        assert theta["average_abs"] ** 2 < mean_square
    errors = rng.normal(size=(625, 4))
    degrees, metres = experiment.table3(errors), experiment.table3(errors * [1e-3, 1e-3, 1e-3, 1])
    radians = experiment.table3(np.radians(errors))
    assert degrees[3, 2] == metres[3, 2]  # no millimetre in it
    assert radians[3, 2] == pytest.approx(degrees[3, 2] * (np.pi / 180) ** 2)


def test_erratum_8_table_3_changes_y_by_more_than_the_law_can(h4, table2):
    """Section 4 finds no change. x and z are beyond the law for a constant θ error only."""
    printed = article.table3()
    usual, redundant = (
        np.array([printed[law][c, "sum_sq"] for c in "xyz"]) for law in ("usual", "redundant")
    )
    change = 100 * np.abs(redundant / usual - 1)
    assert change == pytest.approx([14, 20, 17], abs=0.5)

    J, left = h4.jacobian(table2), experiment.theta_law(h4, table2)
    gain = np.einsum("nij,nj->ni", J[:, :3], J[:, 3]) * left[:, None]  # m per rad of θ's error

    def limit(squares):  # Cauchy and Schwarz; of Σ δ², mm²
        return 100 * (2 * np.sqrt(usual * squares) + squares) / usual

    bias, total = (printed["usual"]["theta", s] for s in ("average", "sum_sq"))
    per_degree = 1e3 * np.radians(gain)
    constant = limit(((bias * per_degree) ** 2).sum(axis=0))
    anything = limit(total * (per_degree**2).max(axis=0))
    assert constant == pytest.approx([3.2, 2.6, 5.7], abs=0.05)
    assert anything == pytest.approx([15.6, 8.7, 22.5], abs=0.05)
    assert (change > 2 * constant).all()
    assert (change > anything).tolist() == [False, True, False]
    for errors in np.random.default_rng(0).normal(size=(200, 625)):
        pattern = errors * np.sqrt(total / (errors**2).sum())
        assert (limit(((pattern[:, None] * per_degree) ** 2).sum(axis=0)) < anything).all()
    for truth in experiment.draw_robots(h4, 10, seed=0):  # the exact statics keep the limit
        usual_x, tej_x = (tp.steady_state(h4, truth, table2, law) for law in ("joint", "tej"))
        theta = (usual_x - table2)[:, 3]
        moved = ((tej_x - usual_x)[:, :3] ** 2).sum(axis=0)
        assert (moved < 1.5 * (gain**2).max(axis=0) * (theta**2).sum()).all()
