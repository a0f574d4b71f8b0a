// Warm-up: base, arms and rods grow with temperature, each by a share of its size.
#include "control/warm_up.hpp"

namespace truepose {
void WarmUp::average(const GrowthRows& M, const ReadingCovariance& V, const Reading& p, int r,
                     Real since, Real memory) {
  GrowthRows W = M;
  Reading y = p;
  for (int m = 0; m < kGrowths; ++m) V.whiten(r, &W[0][m], kGrowths);
  V.whiten(r, y.data(), 1);
  averaged = std::min(averaged + since, memory);
  const Real share = since < averaged ? since / averaged : 1;
  for (int m = 0; m < kGrowths; ++m) {
    Growths sum{};
    Real of_p = 0;
    for (int k = 0; k < r; ++k) {
      for (int l = 0; l < kGrowths; ++l) sum[l] += W[k][m] * W[k][l];
      of_p += W[k][m] * y[k];
    }
    for (int l = 0; l < kGrowths; ++l) information[m][l] += share * (sum[l] - information[m][l]);
    score[m] += share * (of_p - score[m]);
  }
}

Reading WarmUp::explain(const GrowthRows& M, int r,
                        Matrix<kMaxSensors, kMaxSensors>& geometry) const {
  auto precision = information;
  Growths size, tau = score;
  for (int m = 0; m < kGrowths; ++m) size[m] = precision[m][m] += 1;
  const Ldlt factored(kGrowths, precision, size);
  if (!factored.regular()) return {};
  factored.solve(tau);
  Reading offset{};
  for (int k = 0; k < r; ++k) {
    Growths column = M[k];
    factored.solve(column);
    for (int m = 0; m < kGrowths; ++m) {
      offset[k] += M[k][m] * tau[m];
      for (int l = 0; l <= k; ++l) geometry[k][l] += M[l][m] * column[m];
    }
  }
  return offset;
}

GrowthRows growth_rows(const Robot& robot, const Real* PH, const Growths& growth) {
  const int width = parameter_count(robot);
  GrowthRows M{};
  for (int i = 0; i < robot.chains; ++i) {
    const auto grows = [&](int kind, ChainParameter of, Real size) {
      const int column = chain_column(i) + static_cast<int>(of);
      for (int k = 0; k < robot.r; ++k)
        M[k][kind] += growth[kind] / kMostGrowth * size * PH[k * width + column];
    };
    const Chain& chain = robot.chain[i];
    grows(0, ChainParameter::base_x, chain.base[0]);
    grows(0, ChainParameter::base_y, chain.base[1]);
    grows(0, ChainParameter::base_z, chain.base[2]);
    grows(1, ChainParameter::arm, chain.arm);
    grows(2, ChainParameter::rod, chain.rod);
  }
  return M;
}
}  // namespace truepose
