// The engine: a mechanism is bodies on joints in a tree from the base, closures between them, and
// freedoms y that are held or unknown.
//
// The velocities of a rod's two ends have the same component along it, so the derivative of every
// closure and every reading, by any freedom or displacement, is *twist times line*.
#pragma once

#include "mechanism/fkm.hpp"

namespace truepose::engine {
/// A list of freedoms: the unknown ones of a solution, or the held ones that move.
struct Freedoms {
  int count = 0;
  std::array<int, kFreedoms> index;

  void add(int first, int end) {
    for (int j : range(first, end)) index[count++] = j;
  }
};
Freedoms motors(const Mechanism& mechanism);
/// x and h, which follow from the motors.
Freedoms forward(const Mechanism& mechanism);
/// q and h, which follow from x.
Freedoms inverse(const Mechanism& mechanism);

/// Velocity of the body's point at the base's origin, and angular velocity.
struct Twist {
  Vec3 velocity, turn;
};
/// A force along a line and its moment about the base's origin; any derivative by a body's motion.
struct Line {
  Vec3 force, moment;
};
inline Line line_through(const Vec3& point, const Vec3& force) {
  return {force, point.cross(force)};
}

/// Twist times line.
inline Real operator*(const Twist& twist, const Line& line) {
  return twist.velocity.dot(line.force) + twist.turn.dot(line.moment);
}

/// Frame of a body, and the twists that its own freedoms give it.
struct Frame {
  Vec3 p;
  Mat3 R;
  std::array<Twist, 3> twist;
};

/// A mechanism in one position, its loops closed or not.
struct Position {
  std::array<Real, kFreedoms> y{};
  std::array<Frame, kBodies> frame;
  std::array<Vec3, kClosures> A, B;
  std::array<Line, kClosures> line;      ///< ∂f/∂(motion of A's body); of B's body with a minus
  std::array<Real, kClosures> f;         ///< (|A - B|² - L²)/2, or a plane's distance
  std::array<Real, kClosures> stress{};  ///< of an elastic mechanism, already taken from f
  Real cost = 0;                         ///< Σf²
  Real residual = 0;                     ///< largest gap, m

  Vec3 point(int body, const Vec3& x) const {
    return body < 0 ? x : frame[body].p + frame[body].R * x;
  }
  Vec3 direction(int body, const Vec3& x) const { return body < 0 ? x : frame[body].R * x; }
};

/// A row over all freedoms: the derivative of a closure or reading.
using Row = std::array<Real, kFreedoms>;

Real length_of(const Mechanism& mechanism, const Position& at, int closure);
/// How far a closure is open, m: how much too long its ends' distance is, or how far off its plane.
Real gap(const Mechanism& mechanism, const Position& at, int closure);

/// Frames of all bodies and values of all closures from y. @param moving  bodies to place, as bits
void place(const Mechanism& mechanism, Position& at, unsigned moving = ~0u);

/// Adds sign · (twist times line) by every freedom that moves a body.
void add_line(const Mechanism& mechanism, const Position& at, int body, const Line& line, Real sign,
              Row& row);

/// ∂f/∂y of a closure. @param size  in, out: adds what |∂f/∂y|² would be if y moved the ends along
/// the line; makes tests of rank independent of metres and radians
Row row(const Mechanism& mechanism, const Position& at, int closure, Row& size);
Row row(const Mechanism& mechanism, const Position& at, int closure);

/// Whether a body carries another one, or is it.
bool carries(const Mechanism& mechanism, int body, int carried);

/// Type 1 conditioning: share of B's motion by its motor that is along the rod, -1 to 1; 0: its arm
/// and rod are in line.
Real serial(const Mechanism& mechanism, const Position& at, int closure);
/// Type 2 conditioning of the forward solution, as Conditioning::parallel().
Real parallel(const Mechanism& mechanism, const Position& at);

/// Sign of a closure's derivative by the motor that moves B, which tells working modes apart; 0:
/// its arm and rod are in line.
int mode_of(const Mechanism& mechanism, const Position& at, int closure);
/// Whether an arm and its rod are in line.
inline bool stretched(const Mechanism& mechanism, const Position& at, int closure) {
  return mechanism.closure[closure].motor >= 0 && mode_of(mechanism, at, closure) == 0;
}

/// A = ∂f/∂unknown of all closures. @param stressed  an elastic mechanism's stress is one unknown
/// more, the last
struct ClosureRows {
  ClosureRows(const Mechanism& mechanism, const Position& at, const Freedoms& unknown,
              bool stressed);
  std::array<Row, kClosures> by;  ///< ∂f/∂y
  std::array<Unknowns, kClosures> A;
  Unknowns size{};  ///< as of Factors
};

/// The closures' equations A δ = b for the unknown freedoms; in least squares where there are more
/// closures (redundant motors).
struct Equations : ClosureRows, Factors {
  Equations(const Mechanism& mechanism, const Position& at, const Freedoms& unknown, Real damping,
            bool stressed)
      : ClosureRows(mechanism, at, unknown, stressed),
        Factors(mechanism.closures, unknown.count + stressed, A.data(), size, damping) {}
  Equations(const Mechanism& mechanism, const Position& at, const Freedoms& unknown,
            Real damping = 0)
      : Equations(mechanism, at, unknown, damping, mechanism.elastic) {}
  Equations(const Equations&) = delete;  // Factors read A
};

/// Solves all closures for the unknown freedoms, the others held, by damped Newton iteration.
/// @param at    in: y, the start; out: the position (the last iterate if not ok)
/// @param near  take a start that closes to rounding as it is, its rank not tested
/// @return unreachable: a rod of no length; not_finite; not_converged; singular; branch_lost: in
/// another working mode; with the closure, in `chain`
FkmResult close(const Mechanism& mechanism, Position& at, const Freedoms& unknown,
                int most = kFkmIterations, bool near = false);

/// Rates of the unknown freedoms by the held ones, -A⁺ ∂f/∂held: rates[i][j] of unknown i by held
/// j.
/// @return singular, with the stretched closure or -1
Outcome follow(const Mechanism& mechanism, const Position& at, const Freedoms& unknown,
               const Freedoms& held, Matrix<kMaxUnknowns, kMaxUnknowns>& rates);

/// Sign of det ∂f/∂(x, h): positions of other sign are in another assembly mode.
int mode_of(const Mechanism& mechanism, const Position& at);

/// Rank of a matrix, its columns in units of their own size: elimination with full pivoting, a
/// pivot below 1e-6 counting as zero. @param order, held  out: rows, columns, the independent first
int rank(std::array<Row, kClosures> m, int rows, int columns,
         std::array<int, kClosures>* order = nullptr, std::array<int, kFreedoms>* held = nullptr);

/// What is wrong with a description.
enum class Flaw : int {
  none = 0,
  too_many_bodies = 1,    ///< amount: how many there are
  too_many_freedoms = 2,  ///< amount: how many there are
  too_many_closures = 3,  ///< amount: how many there are
  no_such_part = 4,       ///< a body (part) or closure (kBodies + part) with an invalid index
  circle = 5,             ///< body: does not come after its parent, so that they run in a circle
  no_length = 6,          ///< closure: a rod of no length
  open = 7,               ///< closure: the widest that cannot be closed; amount: its gap (m)
  unmoved = 8,            ///< closure: nothing moves one of its ends against the other
  idle = 9,               ///< motor: moves nothing
  dependent = 10,         ///< closure: follows from the others; amount: how many do
  loose = 11,             ///< freedom: no closure holds it; amount: how many of x and h
};
struct Check {
  Flaw flaw = Flaw::none;
  int part = -1;
  Real amount = 0;
  explicit operator bool() const { return flaw == Flaw::none; }
};

/// Examines counts, indices and the order of bodies.
Check check_parts(const Mechanism& mechanism);

/// Examines a description at a home that should close. @param at  in: y, with the motors where
/// their search starts; out: the position
Check check(const Mechanism& mechanism, Position& at);
}  // namespace truepose::engine
