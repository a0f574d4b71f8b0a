"""Table 3 for one robot: 625 poses, at steady state under joint and TEJ control."""

import truepose as tp
from truepose.paper import article, experiment

nominal = tp.load("h4")
robots = experiment.draw_robots(nominal, 1, seed=0)  # one robot with the paper's errors
result = experiment.run(nominal, robots)
printed = article.table3()

print(f"{len(result.poses)} poses; mm and degrees, squares of them; (the paper's robot)")
for row, quantity in enumerate(article.QUANTITIES):
    for column, statistic in enumerate(article.STATISTICS):
        line = f"{quantity:9} {statistic:13}"
        for law, paper in (("joint", "usual"), ("tej", "redundant")):
            value = result.tables[law][0, row, column]
            theirs = printed[paper].get((quantity, statistic), "")
            line += f" {law} {value:10.3f} ({theirs:>7})"
        print(line)

ratio = result.ratio("theta", "sum_sq")[0]
print(f"the TEJ leaves {ratio:.4f} of θ's sum of squares with a perfect sensor")
