// Kernels of every mobility, compiled once at full optimisation in the library `truepose_kernels`.
// Files that include this header must link it; without this header the core's templates are
// compiled where they are used.
#pragma once

#include "truepose/control/command.hpp"
#include "truepose/control/control.hpp"
#include "truepose/control/fault_monitor.hpp"
#include "truepose/estimation/estimate.hpp"
#include "truepose/estimation/online_calibrator.hpp"
#include "truepose/full/linearise.hpp"

/// Kernels of one mobility. Inverse model, Jacobian, TEJ and dynamics are not among them: they are
/// short, and a tenth faster inlined. @param PREFIX  extern, or nothing to compile them
#define TRUEPOSE_KERNELS(PREFIX, K)                                                               \
  PREFIX template FkmResult fkm<K>(const Robot&, const Joint&, Pose&, int);                       \
  PREFIX template FkmResult search<K>(const Robot&, const Joint&, Pose&, int);                    \
  PREFIX template Outcome command<K>(const Robot&, const Pose&, Joint&, Real*);                   \
  PREFIX template Outcome linearise<K>(const Robot&, const Pose&, Extended&,                      \
                                       Matrix<kMaxReadings, kDof<K>>&, Real*);                    \
  PREFIX template Outcome fuse<K>(const Robot&, const Knowledge&, const ReadingCovariance&,       \
                                  const Matrix<kMaxReadings, kDof<K>>&, Fusion<K>&);              \
  PREFIX template Outcome redundant_fkm<K>(const Robot&, const Extended&, const Vec3&, Pose&);    \
  PREFIX template Outcome refer<K>(const Robot&, Law, const Coordinates&, Reference<K>&, Real,    \
                                   const Weighing&, Parasitic*);                                  \
  PREFIX template Outcome motor_error<K>(const Robot&, Law, const Reference<K>&, const Extended&, \
                                         Joint&, Pose&, const Weighing&, const Parasitic&);       \
  PREFIX template Outcome control<K>(const Robot&, const ControlSettings&, const Setpoint&,       \
                                     const Extended&, ControlState&, const Weighing&);            \
  PREFIX template Outcome calibrate_online<K>(OnlineCalibrator&, const Extended&);                \
  PREFIX template Outcome monitor_faults<K>(const Robot&, const FaultMonitorSettings&,            \
                                            const Weighing&, const Joint&, const Extended&,       \
                                            FaultMonitor&, Extended&, Multirate*);                \
  TRUEPOSE_KERNELS_OF_LEVEL(PREFIX, K, IdealModel)

#define TRUEPOSE_KERNELS_OF_LEVEL(PREFIX, K, MODEL)                                               \
  PREFIX template Estimate<K> estimate<K, MODEL>(const Robot&, const Knowledge&, const Extended&, \
                                                 Pose&, Real*, Parasitic*);                       \
  PREFIX template Outcome observe<K, MODEL>(const Robot&, const OnlineSettings&, const Extended&, \
                                            OnlineState&, Robot&, Pose&, Real*);

/// Kernels of a mobility with paired rods: the full level of the others is their ideal one.
#define TRUEPOSE_FULL_KERNELS(PREFIX, K)                                                          \
  PREFIX template FullResult fkm_full<K>(const Robot&, const Joint&, FullPose&, FullClosure<K>&,  \
                                         int);                                                    \
  PREFIX template FullResult ikm_full<K>(const Robot&, const Pose&, FullClosure<K>&, Parasitic*); \
  PREFIX template Outcome jacobian_full<K>(const Robot&, const FullClosure<K>&,                   \
                                           FullJacobians<K>&);                                    \
  PREFIX template Outcome rkm_full<K>(const Robot&, const FullClosure<K>&, Reading&,              \
                                      std::array<FullRow, kMaxSensors>&);                         \
  PREFIX template Outcome same_full_mode<K>(const Robot&, const Coordinates&);                    \
  PREFIX template Outcome linearise_full<K>(const Robot&, const Pose&, Extended&,                 \
                                            Matrix<kMaxReadings, kDof<K>>&, Real*, Parasitic*);   \
  TRUEPOSE_KERNELS_OF_LEVEL(PREFIX, K, FullModel)

#define TRUEPOSE_PLANE_AND_SPACE_KERNELS(PREFIX)         \
  TRUEPOSE_KERNELS(PREFIX, Mobility::planar_translation) \
  TRUEPOSE_KERNELS(PREFIX, Mobility::planar)             \
  TRUEPOSE_KERNELS(PREFIX, Mobility::spatial)
#define TRUEPOSE_PAIRED_KERNELS(PREFIX)                \
  TRUEPOSE_KERNELS(PREFIX, Mobility::translation)      \
  TRUEPOSE_KERNELS(PREFIX, Mobility::schoenflies)      \
  TRUEPOSE_FULL_KERNELS(PREFIX, Mobility::translation) \
  TRUEPOSE_FULL_KERNELS(PREFIX, Mobility::schoenflies)
#ifdef TRUEPOSE_NO_ROTATIONAL
#define TRUEPOSE_ROTATIONAL_KERNELS(PREFIX)
#else
#define TRUEPOSE_ROTATIONAL_KERNELS(PREFIX)        \
  TRUEPOSE_KERNELS(PREFIX, Mobility::rotational_1) \
  TRUEPOSE_KERNELS(PREFIX, Mobility::rotational_2) \
  TRUEPOSE_KERNELS(PREFIX, Mobility::rotational_3)
#endif

namespace truepose {
TRUEPOSE_PLANE_AND_SPACE_KERNELS(extern)
TRUEPOSE_PAIRED_KERNELS(extern)
TRUEPOSE_ROTATIONAL_KERNELS(extern)
}  // namespace truepose
