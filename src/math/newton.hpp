// Newton iteration for loop closure, damped where a step fails.
#pragma once

#include <utility>

#include "math/real.hpp"

namespace truepose {
// Thresholds of a search: residuals in units of the largest length.
/// Below this rounding dominates.
inline constexpr Real kRounding = by_precision(2e-15, 1e-7);
/// Below this the loops are closed.
inline constexpr Real kClosed = by_precision(1e-12, 1e-5);
/// Below this the factors of one step also serve the next.
inline constexpr Real kChord = by_precision(1e-9, 1e-4);
/// Below this rounding explains a step without gain.
inline constexpr Real kNothingToGain = by_precision(1e-13, 3e-6);

/// Below this a search that goes on slowly is near a double root: its steps halve the distance, and
/// the residual goes with their square.
inline constexpr Real kCrawls = by_precision(1e-9, 1e-6);
/// Steps that suffice unless the search is near a singular position.
inline constexpr int kUsualSteps = 24;

/// Result of Newton's method.
struct NewtonEnd {
  int iterations = 0;   ///< steps tried
  bool regular = true;  ///< whether the last factors had full rank
  Real damping = 0;     ///< of the last step; 0: undamped

  /// Whether a search with open loops was converging slowly to a singular position. (J_x is
  /// singular also where a search ends with wide gaps, but that excludes no other positions.)
  bool crawls(Real residual, Real scale) const {
    return residual < kCrawls * scale && (damping > 0 || iterations > kUsualSteps);
  }
};

/// Newton's method for f = 0. A step that does not lower Σf² is retried with Levenberg's damping.
/// Converged when the residual reaches rounding. State: `cost`, Σf²; `residual`, in scale's unit.
/// @param current  in: the start; out: the last state that lowered the cost
/// @param trial    work space
/// @param scale    the largest length that f compares
/// @param most     maximum iterations
/// @param factor   factor(state, damping): factors of the step's equations, with regular()
/// @param step     step(state, factors, after): computes the state after the step
/// @param settled  share of the cost by which an undamped step must change it, or it is the last:
/// where more equations than unknowns leave a cost. 0: none is
template <class State, class Factor, class Step>
inline NewtonEnd damped_newton(State*& current, State*& trial, Real scale, int most,
                               Factor&& factor, Step&& step, Real settled = 0) {
  const Real rounding = kRounding * scale;
  NewtonEnd end;
  do {
    const auto factors = factor(*current, end.damping);
    end.regular = factors.regular();
    if (!end.regular) {
      ++end.iterations;
      end.damping = max(10 * end.damping, 1e-3);
      continue;
    }
    // Near the solution the same factors serve a second, chord step: its error is the product of
    // two small ones, and it costs a third of a new factorisation.
    do {
      ++end.iterations;
      step(*current, factors, *trial);
      if (settled > 0 && end.damping == 0 &&
          fabs(trial->cost - current->cost) < settled * current->cost) {
        if (trial->cost < current->cost) std::swap(current, trial);
        return end;
      }
      if (!(trial->cost < current->cost)) {
        end.damping = max(10 * end.damping, 1e-3);
        break;
      }
      end.damping = end.damping > 1e-3 ? 0.1 * end.damping : 0;
      std::swap(current, trial);
    } while (end.damping == 0 && current->residual > rounding &&
             current->residual < kChord * scale && end.iterations < most);
    // A step refused at the level of rounding is not a failure.
    if (current->residual <= rounding ||
        (end.damping > 0 && current->residual < kNothingToGain * scale))
      break;
  } while (end.iterations < most && end.damping < 1e12);
  return end;
}
}  // namespace truepose
