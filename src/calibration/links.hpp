// Differences between visited poses as linear equations in ξ, with the poses eliminated.
//
// Examples: a plane touched by the tool, the distance of two tool points, a point visited again.
// f(x_i, x_j, w) is measured to within σ, with unknowns w of its own. A row's pose is known up to
// the noise of its elimination (line.hpp): R δx = e - B δu + ν, ν normal with unit covariance. With
// G = ∂f/∂x R⁻¹ / σ, a block of links that share rows gives
//
//   y = B' δu + G ν + ε,  y = (measured - f)/σ - Σ G e,  B' = ∂f/∂w S / σ - Σ G B,
//
// equations whose noise has the covariance C = I + GGᵀ: as exact as the elimination of a row. The
// poses gain ν̂ = GᵀC⁻¹(y - B' δu). Under a robust loss each ε has its own weight.
#pragma once

#include <functional>
#include <vector>

#include "calibration/line.hpp"

namespace truepose {
/// Kinds of links between tool points p = D + R c.
enum class LinkKind : int {
  plane = 0,     ///< p_z - h - a p_x - b p_y; other axes cyclically: x, y, z, x, …
  distance = 1,  ///< (1 + scale) |p_i - p_j| + times · width
  point = 2,     ///< a coordinate of p_i - p_j
};

/// Weight of a link that is ignored: 0 has no inverse.
inline constexpr double kNothing = 1e-8;

/// One measured difference.
struct Link {
  LinkKind kind = LinkKind::plane;
  std::array<int, 2> line{};  ///< rows; for a plane only the first
  int tool = 0;               ///< first of the three unknowns c
  int shape = 0;              ///< first of h, a, b; or of scale and width
  int axis = 2;               ///< of the plane's normal or the point's coordinate
  double times = 0;           ///< 1 outside a printed part, -1 inside, 0 from middle to middle
  double measured = 0, sigma = 1;

  int ends() const { return kind == LinkKind::plane ? 1 : 2; }
};

/// All measured differences of a log.
struct Links {
  std::vector<Link> link;
  std::vector<double> mean;  ///< of their unknowns w; σ = 0 of the known ones
  int first = 0;             ///< index of w in the prior
};

/// Expected value of a link, and its derivatives.
struct LinkExpected {
  double value = 0;
  std::array<Coordinates, 2> H_x{};       ///< by the twist of each row's pose
  std::array<double, 3> tool{}, shape{};  ///< by its unknowns
};

/// @param w  unknowns of all links
LinkExpected expected(Mobility mobility, const Link& link, const Pose* poses, const double* w);

/// Links that share rows and therefore the noise of their poses.
struct LinkBlock {
  /// An end of a link: the entry of `link`, and the row whose pose it has.
  struct End {
    int link, line;
  };
  std::vector<int> link;  ///< indices of the links
  std::vector<End> end{};
  std::vector<double> e{};  ///< (measured - f)/σ at these poses
  RowMatrix B{};
  std::vector<double> y{};
  RowMatrix G{};                 ///< of each end
  RowMatrix shared{};            ///< GGᵀ
  std::vector<double> weight{};  ///< c of every link: C = diag(1/c) + GGᵀ
  RowMatrix C{};                 ///< Cholesky factor of C
  double cost = 0;               ///< at the best poses

  int size() const { return int(link.size()); }
  void weigh(std::vector<double> by);
  /// Weighs each link by the loss of its own ε, at the optimal ν; outliers by `kNothing`. Each
  /// round lowers the cost, because a loss is a concave function of ε².
  void weigh(const RowLoss& loss, const std::vector<char>& outlier);
};

/// The links as equations in ξ, in blocks that share rows.
/// @param poses, lines  of the log; a line without rows is unknown
/// @param known  parameters including w; without a root in units of each (m, rad, one)
std::vector<LinkBlock> linked(Mobility mobility, const Links& links, const double* w,
                              const Knowledge& known, const std::vector<Pose>& poses,
                              const std::vector<Line>& lines);

/// Number of the equations free of poses.
int equation_count(const std::vector<Line>& lines, const std::vector<LinkBlock>& blocks);

/// Calls f(row of B, y, row of the log, whether it is of links) for these equations, with noise of
/// unit covariance; the row of a block of links is its first one.
void each_equation(const std::vector<Line>& lines, const std::vector<LinkBlock>& blocks,
                   const std::function<void(const double*, double, int, bool)>& f);

/// Adds the links' effect on every row's ν after the change `step` of u to its `pull`.
void pull(const LinkBlock& block, const std::vector<double>& step, std::vector<Line>& lines);

/// Result for one measured difference, in its own unit. NaN: of an excluded row.
struct LinkResult {
  double residual = NAN;  ///< measured minus expected, with all data
  double left_out = NAN;  ///< the same without this one's own data, to first order
  double sigma = NAN;     ///< of left_out
  double weight = 0;      ///< 1, or less where it is an outlier
};

/// Cross-validates each link against all other data. With V the covariance of all their y,
/// V⁻¹(y - B û₋) = C⁻¹(y - B û), V⁻¹ = C⁻¹ - C⁻¹B Σ BᵀC⁻¹ =: P (Woodbury), û and Σ of all data.
/// Entry k over P_kk is the residual of link k without itself, σ² = 1/P_kk.
/// @param root  of the information on u, Σ⁻¹
void cross_validate(const Links& links, const LinkBlock& block, const RowMatrix& root,
                    std::vector<LinkResult>& result);
}  // namespace truepose
