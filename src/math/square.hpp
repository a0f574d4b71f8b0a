// Solution of a small system, square or in least squares: Newton's step, the columns of J, the sign
// of det J_x.
#pragma once

#include <utility>

#include "math/ldlt.hpp"

namespace truepose {
using Unknowns = std::array<Real, kMaxUnknowns>;
/// Rows of a small matrix, or of its inverse.
using Square = std::array<Unknowns, kMaxUnknowns>;

/// Factors of A, rows×n. Square: the inverse up to 4×4, else LU with pivots by rows. With more
/// rows, or damped: LU of the normal equations (AᵀA + damping · diag(size)) x = Aᵀ b, least squares
/// and Levenberg's steps.
///
/// size[j] is what |column j|² would be without cancellation: the unit that makes the test of
/// singularity independent of metres and radians.
class Factors {
 public:
  /// @param a  its rows; least squares read them again, for every solution
  Factors(int rows, int n, const Unknowns* a, const Unknowns& size, Real damping = 0);
  /// Whether A has full rank.
  bool regular() const { return regular_; }
  /// Sign of det A, -1, 0 or 1; of least squares: 0.
  int sign() const { return sign_; }

  /// A⁺ b.
  Unknowns solve(const Real* b) const;
  /// Column j of A⁺.
  Unknowns column(int j) const;
  /// A⁺, of at most kMaxUnknowns rows of A.
  void invert(Square& inverse) const;

 private:
  /// The inverse of the columns (a, x), (b, y), (c, z), (d, w), filled up with the identity's, by
  /// cross products: without branches, at a third of the cost of a factorisation.
  void adjugate(const Unknowns& size);
  void factorise(const Unknowns& size);

  int rows_, n_;
  const Unknowns* a_;
  bool square_, small_, regular_ = true;
  int sign_;
  Square lu_;  ///< of A with its rows in this order: L's entries, then U's; small: the inverse
  Unknowns inverse_;  ///< of the pivots
  std::array<int, kMaxUnknowns> order_;
};

/// Result of an inversion.
struct Inverted {
  bool regular = false;  ///< A has full rank
  int sign = 0;          ///< of det A; not square: 0
  explicit operator bool() const { return regular; }
};

/// A⁻¹ by rows, or A⁺ = (AᵀA)⁻¹Aᵀ where A has more rows than columns. @param size  as of Factors
Inverted invert(int rows, int n, const Square& a, const Unknowns& size, Square& inverse);

/// Sign of the determinant, -1, 0 or 1.
inline int determinant_sign(int n, const Square& a) { return Factors(n, n, a.data(), {}).sign(); }
}  // namespace truepose
