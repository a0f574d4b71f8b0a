// Evidence for hypotheses: columns of unknown amounts in whitened equations.
#include "estimation/evidence.hpp"

namespace truepose {
Evidence evidence(int n, Real* S, Real* z) {
  Evidence found;
  for (int i : range(n)) {  // Cholesky and forward substitution, row by row
    Real* row = S + i * n;
    for (int j : range(i + 1)) {
      Real sum = row[j] + (i == j);
      for (int k : range(j)) sum -= row[k] * S[j * n + k];
      row[j] = i == j ? sqrt(max(sum, Real(1))) : sum / S[j * n + j];
    }
    for (int k : range(i)) z[i] -= row[k] * z[k];
    z[i] /= row[i];
    found.chi2 += z[i] * z[i];
    found.log_odds -= log(row[i]);
  }
  found.log_odds += found.chi2 / 2;
  return found;
}

int outstanding(int count, const Extended& value, Real margin) {
  const auto end = value.begin() + count;
  const auto most = std::max_element(value.begin(), end);
  for (auto other = value.begin(); other != end; ++other)
    if (other != most && *other > *most - margin) return -1;
  return int(most - value.begin());
}
}  // namespace truepose
