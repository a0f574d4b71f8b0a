// How does a robot learn its geometry while it works? One line of readings a cycle.
//
// A square-root filter on ξ. The pose of the moment is unknown and eliminated (eliminate.hpp): r
// equations about ξ alone remain, and each updates the root S of the covariance, Σ_ξ = S Sᵀ
// (Carlson's triangular form; Bierman, Factorization Methods for Discrete Sequential Estimation,
// 1977, chapter V). Bounded work, no allocation, no exception.
#pragma once

#include "truepose/eliminate.hpp"
#include "truepose/estimate.hpp"
#include "truepose/geometry.hpp"

namespace truepose {

/// What the filter knows. The arrays are the caller's; it starts from the prior.
struct OnlineState {
  int count = 0;                ///< p, uncertain parameters
  const int* column = nullptr;  ///< each one's column of H_ξ
  double* xi = nullptr;         ///< ξ̂, parameter_count values
  double* root = nullptr;       ///< S, p×p by rows, lower triangular
  Extended sigma{};             ///< σ of every reading's own error, > 0
  int due = 0;                  ///< the drift whose turn is next
};

struct OnlineSettings {
  int drifts = 0;  ///< independent random walks, each of one or several parameters together
  const double* drift = nullptr;  ///< drifts × p: change of every parameter by one σ in one cycle
  const double* linearised = nullptr;  ///< ξ about which to linearise (replay); nullptr: ξ̂ itself
  double gate = 0;  ///< an equation off by more of its own σ is left out (0: none)
};

/// How much readings curve, per m or rad: a few times one over the lengths of a robot, since its
/// Jacobians multiply it. Chosen by trial on H4s: with 1 and with 8 one pass ends further from the
/// batch than with 12.
inline constexpr double kCurvature = 12;

/// doubles of work space that `observe` needs
inline int online_work(const Robot& robot, int count) {
  return (dof(robot.mobility) + robot.r) * (parameter_count(robot) + count) + 2 * count;
}

namespace online_detail {

/// f = Sᵀh. @return h S Sᵀ hᵀ, how far ξ leaves the equation open, in units of its variance
inline double spread(int p, const double* S, const double* h, double* f) {
  double sum = 0;
  for (int j = 0; j < p; ++j) f[j] = 0;
  for (int i = 0; i < p; ++i)
    for (int j = 0; j <= i; ++j) f[j] += S[i * p + j] * h[i];
  for (int j = 0; j < p; ++j) sum += f[j] * f[j];
  return sum;
}

/// One equation h·δξ = y. @param alpha  its variance @param f  Sᵀh
/// @param b  out: the gain times what is returned
inline double update_root(int p, double* S, const double* f, double alpha, double* b) {
  for (int j = 0; j < p; ++j) b[j] = 0;
  for (int j = p - 1; j >= 0; --j) {
    const double before = alpha;
    alpha += f[j] * f[j];
    const double beta = std::sqrt(before / alpha), lambda = f[j] / before;
    for (int i = j; i < p; ++i) {
      const double old = S[i * p + j];
      S[i * p + j] = beta * (old - lambda * b[i]);
      b[i] += f[j] * old;
    }
  }
  return alpha;
}

/// S Sᵀ + v vᵀ, triangular again, by one rotation a column. @param v  p; spoilt
inline void add_drift(int p, double* S, double* v) {
  for (int k = 0; k < p; ++k) {
    const double length = std::sqrt(S[k * p + k] * S[k * p + k] + v[k] * v[k]);
    if (!(length > 0)) continue;
    const double c = S[k * p + k] / length, s = v[k] / length;
    for (int i = k; i < p; ++i) {
      const double old = S[i * p + k];
      S[i * p + k] = c * old + s * v[i];
      v[i] = c * v[i] - s * old;
    }
  }
}

}  // namespace online_detail

/// One cycle: ξ̂ and S learn from one line of readings.
///
/// @param drawn  as set_parameters takes it
/// @param robot  in: any copy of it; out: the robot at the ξ of linearisation
/// @param pose   in: a guess; out: x̂ before ξ̂ moved
/// @param work   online_work(drawn, count) doubles
/// @return anything but ok: nothing was learnt, the state is as it was
template <Mobility K, class Model = IdealModel>
inline Outcome observe(const Robot& drawn, const OnlineSettings& settings, const Extended& q_e,
                       OnlineState& state, Robot& robot, Pose& pose, double* work) {
  constexpr int n = kDof<K>;
  const int rows = n + drawn.r, p = state.count;
  if (!all_finite(q_e, rows)) return {Status::not_finite, -1};
  double *H_xi = work, *B = H_xi + rows * parameter_count(drawn), *f = B + rows * p, *b = f + p;
  const Knowledge known{p, state.column, state.root, state.sigma};
  set_parameters(drawn, settings.linearised ? settings.linearised : state.xi, robot);
  Joint q{};
  for (int i = 0; i < n; ++i) q[i] = q_e[i];
  Pose at;
  Parasitic rest;
  Status status = Status::ok;
  for (const Pose& from : {pose, to_pose<K>(robot.home)}) {
    at = from;
    status = Model::template fkm<K>(robot, q, at, rest);
    if (status == Status::ok) break;
  }
  if (status != Status::ok) return {status, -1};

  RowsOfPose A;
  std::array<double, kMaxRows> e;
  for (const bool last : {false, true}) {  // from the motors' pose to that of all readings
    Extended expected, residual;
    Matrix<kMaxReadings, n> H_x;
    const Outcome outcome =
        Model::template linearise<K>(robot, at, expected, H_x, last ? H_xi : nullptr, rest);
    if (!outcome) return outcome;
    innovation(robot, q_e, expected, residual);
    for (int c = 0; c < rows; ++c) {
      for (int j = 0; j < n; ++j) A[c][j] = H_x[c][j] / state.sigma[c];
      e[c] = residual[c] / state.sigma[c];
    }
    if (last) gather(robot, known, H_xi, rows, B);
    if (!eliminate(n, rows, A, B, last ? p : 0, e)) return {Status::singular, -1};
    Joint step{};
    for (int i = 0; i < n; ++i) step[i] = e[i];
    back_substitute(n, A, step);
    if (!all_finite(step, n)) return {Status::not_finite, -1};
    at = moved<K>(at, step);
  }
  double coarsest = 0;  // σ
  for (int c = 0; c < rows; ++c) coarsest = std::max(coarsest, state.sigma[c]);
  double sum = 0;  // of what the state will keep: one NaN in it would spoil every later cycle
  for (int row = n; row < rows; ++row) sum += e[row];
  for (const double* h = B + n * p; h != B + rows * p; ++h) sum += *h;
  if (!std::isfinite(sum)) return {Status::not_finite, -1};
  pose = at;

  for (int row = n; row < rows; ++row) {
    const double* h = B + row * p;
    double y = e[row];
    if (settings.linearised)
      for (int k = 0; k < p; ++k)
        y -= h[k] * (state.xi[state.column[k]] - settings.linearised[state.column[k]]);
    const double open = online_detail::spread(p, state.root, h, f);
    if (settings.gate > 0 && y * y > settings.gate * settings.gate * (1 + open)) continue;
    // What linearising about a poor ξ̂ leaves out is of second order: the square of what is open.
    // It counts as noise, lest the first lines claim to know what they do not.
    const double curved = settings.linearised ? 0 : kCurvature * open * coarsest;
    const double alpha = online_detail::update_root(p, state.root, f, 1 + curved * curved, b);
    for (int k = 0; k < p; ++k) state.xi[state.column[k]] += b[k] / alpha * y;
    // The rows that follow were linearised before this step.
    if (!settings.linearised)
      for (int later = row + 1; later < rows; ++later)
        for (int k = 0; k < p; ++k) e[later] -= B[later * p + k] * b[k] / alpha * y;
  }
  if (settings.drifts > 0) {  // one a cycle, for all the cycles since its last turn
    state.due = (state.due + 1) % settings.drifts;
    const double cycles = std::sqrt(settings.drifts);
    for (int k = 0; k < p; ++k) f[k] = cycles * settings.drift[state.due * p + k];
    online_detail::add_drift(p, state.root, f);
  }
  return {};
}

}  // namespace truepose
