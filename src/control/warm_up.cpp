#include "control/warm_up.hpp"

namespace truepose {
GrowthRows growth_rows(const Robot& robot, const Parity& parity, const Real* H_xi,
                       const Growths& growth) {
  GrowthRows M{};
  for (int i = 0; i < robot.chains; ++i) {
    const auto grows = [&](int kind, ChainParameter of, Real size) {
      const int column = chain_column(i) + static_cast<int>(of);
      for (int k = 0; k < robot.r; ++k)
        M[k][kind] += growth[kind] / kMostGrowth * size * parity.by(robot, H_xi, k, column);
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
