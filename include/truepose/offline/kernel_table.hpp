// Table of compiled kernels for offline code, which is written once for all mobilities.
//
// n is a run-time value here, and matrices have room for the largest robot.
#pragma once

#include "truepose/estimation/online_calibrator.hpp"
#include "truepose/offline/model_error.hpp"

namespace truepose {
/// Generalised least squares at a pose, as Fusion, and the resulting weighted TEJ.
struct Fused {
  PoseColumns gain;
  ExtendedRows tej;
  PoseMatrix covariance;
};

/// Estimate of a pose; the pose itself is the kernel's output.
struct Found {
  Outcome outcome;
  PoseMatrix covariance;
  double chi2 = 0;
};

/// One mobility at one level of the model. Arguments are as in the functions of the same names.
struct Kernels {
  Mobility mobility = Mobility::spatial;
  int n = 0;
  Status (*fkm)(const Robot&, const Joint& q, Pose&, Parasitic&) = nullptr;
  Outcome (*linearise)(const Robot&, const Pose&, Extended& q_e, PoseRows& H_x, double* H_xi,
                       Parasitic&) = nullptr;
  Outcome (*fuse)(const Robot&, const Knowledge&, const ReadingCovariance&, const PoseRows& H_x,
                  Fused&) = nullptr;
  Found (*estimate)(const Robot&, const Knowledge&, const Extended& q_e, Pose&,
                    double* work) = nullptr;
  Outcome (*observe)(const Robot& drawn, const OnlineSettings&, const Extended& q_e, OnlineState&,
                     Robot&, Pose&, double* memory) = nullptr;
  Outcome (*left_out)(const Robot&, const Knowledge& nuisances, const Pose&, double* H_xi,
                      RowMatrix& D) = nullptr;  ///< where the full level is a separate model
};

namespace kernels_detail {
/// Copies the used part of a matrix into one of another size.
template <class From, class To>
inline void copy(const From& from, int rows, int columns, To& to) {
  for (int i = 0; i < rows; ++i) std::copy_n(from[i].begin(), columns, to[i].begin());
}

template <Mobility K, class Model>
Outcome linearise(const Robot& robot, const Pose& pose, Extended& q_e, PoseRows& H_x, double* H_xi,
                  Parasitic& rest) {
  Matrix<kMaxReadings, kDof<K>> rows;
  const Outcome outcome = Model::template linearise<K>(robot, pose, q_e, rows, H_xi, rest);
  if (outcome) copy(rows, kDof<K> + robot.r, kDof<K>, H_x);
  return outcome;
}

template <Mobility K>
Outcome fuse(const Robot& robot, const Knowledge& known, const ReadingCovariance& C,
             const PoseRows& H_x, Fused& fused) {
  constexpr int n = kDof<K>;
  Matrix<kMaxReadings, n> rows;
  copy(H_x, n + robot.r, n, rows);
  Fusion<K> fusion;
  const Outcome outcome = truepose::fuse<K>(robot, known, C, rows, fusion);
  if (!outcome) return outcome;
  weighted_tej<K>(robot, rows, fusion, fused.tej);
  copy(fusion.gain, n, n + robot.r, fused.gain);
  copy(fusion.covariance, n, n, fused.covariance);
  return outcome;
}

template <Mobility K, class Model>
Found estimate(const Robot& robot, const Knowledge& known, const Extended& q_e, Pose& pose,
               double* work) {
  const Estimate<K> estimate = truepose::estimate<K, Model>(robot, known, q_e, pose, work);
  Found found{estimate.outcome, {}, estimate.chi2};
  copy(estimate.covariance, kDof<K>, kDof<K>, found.covariance);
  return found;
}
}  // namespace kernels_detail

template <Mobility K, class Model>
constexpr Kernels kernels() {
  Kernels table{K,
                kDof<K>,
                &Model::template fkm<K>,
                &kernels_detail::linearise<K, Model>,
                &kernels_detail::fuse<K>,
                &kernels_detail::estimate<K, Model>,
                &observe<K, Model>,
                nullptr};
  if constexpr (kRodByRod<K>) table.left_out = &left_out<K>;
  return table;
}

/// @param full  full level, where it is a separate model
inline Kernels kernels(Mobility mobility, bool full) {
  return with_mobility(mobility, [&]<Mobility K>(Fixed<K>) {
    if constexpr (kRodByRod<K>)
      if (full) return kernels<K, FullModel>();
    return kernels<K, IdealModel>();
  });
}
}  // namespace truepose
