// What is compiled once for the whole module? The large templates that several of its files call:
// instances.cpp has them, the others only declare them.
#pragma once

#include "truepose/estimation/estimate.hpp"
#include "truepose/full/linearise.hpp"

/// Those of every mobility, then those of the full level where the rods come in pairs: the full
/// level of the others is their ideal one.
#define TRUEPOSE_INSTANCES(PREFIX)                     \
  TRUEPOSE_IDEAL(PREFIX, Mobility::planar_translation) \
  TRUEPOSE_IDEAL(PREFIX, Mobility::planar)             \
  TRUEPOSE_IDEAL(PREFIX, Mobility::translation)        \
  TRUEPOSE_IDEAL(PREFIX, Mobility::schoenflies)        \
  TRUEPOSE_IDEAL(PREFIX, Mobility::spatial)            \
  TRUEPOSE_FULL(PREFIX, Mobility::translation)         \
  TRUEPOSE_FULL(PREFIX, Mobility::schoenflies)

#define TRUEPOSE_IDEAL(PREFIX, K)                                                                 \
  PREFIX template FkmResult fkm<K>(const Robot&, const Joint&, Pose&);                            \
  PREFIX template FkmResult search<K>(const Robot&, const Joint&, Pose&, int);                    \
  PREFIX template Outcome linearise<K>(const Robot&, const Pose&, Extended&,                      \
                                       Matrix<kMaxReadings, kDof<K>>&, double*);                  \
  PREFIX template Estimate<K> estimate<K>(const Robot&, const Knowledge&, const Extended&, Pose&, \
                                          double*, Parasitic*);                                   \
  PREFIX template Outcome fuse<K>(const Robot&, const Knowledge&, const ReadingCovariance&,       \
                                  const Matrix<kMaxReadings, kDof<K>>&, Fusion<K>&);

#define TRUEPOSE_FULL(PREFIX, K)                                                                  \
  PREFIX template FullResult fkm_full<K>(const Robot&, const Joint&, FullPose&, FullClosure<K>&); \
  PREFIX template FullResult ikm_full<K>(const Robot&, const Pose&, FullClosure<K>&, Parasitic*); \
  PREFIX template Outcome linearise_full<K>(const Robot&, const Pose&, Extended&,                 \
                                            Matrix<kMaxReadings, kDof<K>>&, double*, Parasitic*); \
  PREFIX template Estimate<K> estimate<K, FullModel>(const Robot&, const Knowledge&,              \
                                                     const Extended&, Pose&, double*, Parasitic*);

namespace truepose {
TRUEPOSE_INSTANCES(extern)
}
