"""Results of the paper's experiments, as they were before."""

from answers import answer

from truepose_paper import article, experiment, twin, virtual_experiment
from truepose_paper.vision import Setup, Vision


def test_paper(kept, h4, table2):
    x = table2[::40]
    found = experiment.run(h4, experiment.draw_robots(h4, 2, seed=3), x)
    held = twin.shipped()
    seen = virtual_experiment.run(held.plant(), h4, Vision(Setup()), x[:4])
    printed = [
        article.table3(),
        article.table3_as_printed(),
        article.simulation_errors(),
        twin.printed(),
        held.truth,
        held.setup,
    ]
    runs = [[run.measured, run.estimated, run.q_e] for run in seen.values()]
    kept(
        answer(
            [
                found.errors,
                found.tables,
                experiment.theta_law(h4, x),
                runs,
                printed,
                [article.paper_directions(h4, k) for k in range(2)],
            ]
        )
    )
