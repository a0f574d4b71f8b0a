// What is compiled once for the whole module? The large templates that several of its files call:
// instances.cpp has them, the others only declare them.
#pragma once

#include "truepose/fkm.hpp"
#include "truepose/full_linearise.hpp"

/// X(prefix, mobility) for every function template of every mobility, then of those whose rods come
/// in pairs; the full level of the others is their ideal one.
#define TRUEPOSE_INSTANCES(PREFIX)                     \
  TRUEPOSE_IDEAL(PREFIX, Mobility::planar_translation) \
  TRUEPOSE_IDEAL(PREFIX, Mobility::planar)             \
  TRUEPOSE_IDEAL(PREFIX, Mobility::translation)        \
  TRUEPOSE_IDEAL(PREFIX, Mobility::schoenflies)        \
  TRUEPOSE_IDEAL(PREFIX, Mobility::spatial)            \
  TRUEPOSE_FULL(PREFIX, Mobility::translation)         \
  TRUEPOSE_FULL(PREFIX, Mobility::schoenflies)

#define TRUEPOSE_IDEAL(PREFIX, K)                                            \
  PREFIX template FkmResult fkm<K>(const Robot&, const Joint&, Pose&);       \
  PREFIX template Outcome linearise<K>(const Robot&, const Pose&, Extended&, \
                                       Matrix<kMaxReadings, kDof<K>>&, double*);

#define TRUEPOSE_FULL(PREFIX, K)                                                                  \
  PREFIX template FullResult fkm_full<K>(const Robot&, const Joint&, FullPose&, FullClosure<K>&); \
  PREFIX template FullResult ikm_full<K>(const Robot&, const Pose&, FullClosure<K>&);             \
  PREFIX template Outcome linearise_full<K>(const Robot&, const Pose&, Extended&,                 \
                                            Matrix<kMaxReadings, kDof<K>>&, double*);

namespace truepose {
TRUEPOSE_INSTANCES(extern)
}
