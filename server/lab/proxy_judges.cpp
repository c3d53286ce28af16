#include "server/lab/proxy_judges.h"

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <limits>
#include <queue>
#include <tuple>
#include <unordered_set>
#include <utility>
#include <vector>

#include "server/lab/triangle_grid.h"

namespace palpate::lab {
namespace {

// Allowance for rounding of positions, relative to the ball.
constexpr double kBallTolerance = 1e-9;

struct Node {
  // Tetrahedron numbers that stand for a whole free cell and for the outside.
  static constexpr int kBox = 30;
  static constexpr int kOutside = 31;

  Vec3i cell = Vec3i::Zero();
  int tetrahedron = kOutside;

  bool operator==(const Node& other) const {
    return cell == other.cell && tetrahedron == other.tetrahedron;
  }
};
static_assert(Node::kBox >= kMaxTetrahedra);

Vec3i Beyond(const Vec3i& cell, int face) {
  Vec3i neighbour = cell;
  neighbour[face / 2] += face % 2 == 1 ? 1 : -1;
  return neighbour;
}

// Returns the number that a vertex on `face` has in the cell beyond the face.
int VertexBeyond(int vertex, int face) {
  if (vertex >= kFirstFaceVertex) return kFirstFaceVertex + (face ^ 1);
  auto offset = kCornerOffset[vertex];
  offset[face / 2] = 1 - face % 2;
  return CornerAt(offset[0], offset[1], offset[2]);
}

class Search {
 public:
  Search(FreshCells& cells, const Vec3& p_DHip_mm, double radius_mm)
      : cells_(cells), centre_mm_(p_DHip_mm) {
    const Mat3& axes = cells.surface().X_DL.linear;
    reach_mm_ = radius_mm * (1.0 + kBallTolerance) + 0.5 * axes.colwise().norm().sum();
  }

  std::vector<Node> NodesAt(const Vec3& p_mm) {
    const Holders holders = cells_.HoldersOf(cells_.surface().X_LD.Apply(p_mm));
    std::vector<Node> nodes;
    for (const Holder& holder : holders.tetrahedra) {
      const FreshCell& cell = cells_.At(holder.cell);
      const Node node{holder.cell, cell.free ? Node::kBox : holder.tetrahedron};
      if (IsFree(cell, node) && std::find(nodes.begin(), nodes.end(), node) == nodes.end()) {
        nodes.push_back(node);
      }
    }
    if (holders.outside && cells_.surface().IsFreeOutside()) nodes.push_back(Node{});
    return nodes;
  }

  // Searches from any of `start` to any of `goals`, nodes nearest to `goal_mm` first. The search
  // does not go through the outside, but notes that it has reached the outside.
  FreePath Run(const std::vector<Node>& start, const std::vector<Node>& goals, const Vec3& goal_mm,
               int most_nodes) {
    goal_mm_ = goal_mm;
    for (const Node& node : start) Enter(node);
    while (!queue_.empty()) {
      const Node node = queue_.top().second;
      queue_.pop();
      if (std::find(goals.begin(), goals.end(), node) != goals.end()) return FreePath::kFound;
      if (static_cast<int>(seen_.size()) > most_nodes) return FreePath::kUnchecked;
      Expand(node);
    }
    return FreePath::kNone;
  }

  bool reached_outside() const { return reached_outside_; }

 private:
  struct Farther {
    template <class Entry>
    bool operator()(const Entry& a, const Entry& b) const {
      return a.first > b.first;
    }
  };

  bool IsFree(const FreshCell& cell, const Node& node) const {
    if (node.tetrahedron == Node::kBox) return cell.free;
    return cell.crossed && cells_.HasFreePart(DensitiesOf(cell, node.tetrahedron));
  }

  void Enter(const Node& node) {
    if (node.tetrahedron == Node::kOutside) {
      if (std::exchange(reached_outside_, true)) return;
      queue_.push({0.0, node});
      return;
    }
    const Vec3 middle_mm =
        cells_.surface().X_DL.Apply(node.cell.cast<double>() + Vec3::Constant(0.5));
    if ((middle_mm - centre_mm_).norm() > reach_mm_) return;
    const auto key = cells_.KeyOf(node.cell) * 32 + static_cast<std::uint64_t>(node.tetrahedron);
    if (!seen_.insert(key).second) return;
    queue_.push({(middle_mm - goal_mm_).norm(), node});
  }

  void Expand(const Node& node) {
    if (node.tetrahedron == Node::kOutside) return;
    const FreshCell& cell = cells_.At(node.cell);
    if (node.tetrahedron == Node::kBox) {
      for (int face = 0; face < 6; ++face) EnterThrough(node.cell, face, 0);
      return;
    }
    const TetrahedralComplex& complex = cell.parts.complex;
    for (int vertex : complex.vertices[node.tetrahedron]) {
      const auto triangle =
          static_cast<std::uint16_t>(complex.vertex_mask[node.tetrahedron] & ~(1u << vertex));
      if (HasFreePart(cell, triangle)) EnterAcross(node, cell, triangle);
    }
  }

  bool HasFreePart(const FreshCell& cell, std::uint16_t mask) const {
    std::vector<double> densities;
    for (int v = 0; v < kMaxVertices; ++v) {
      if ((mask >> v & 1) != 0) densities.push_back(cell.parts.density[v]);
    }
    return cells_.HasFreePart(densities);
  }

  void EnterAcross(const Node& node, const FreshCell& cell, std::uint16_t triangle) {
    const TetrahedralComplex& complex = cell.parts.complex;
    for (int t = 0; t < complex.tetrahedron_count; ++t) {
      if (t == node.tetrahedron || (complex.vertex_mask[t] & triangle) != triangle) continue;
      Enter({node.cell, t});
      return;
    }
    std::uint8_t faces = 0x3f;
    for (int v = 0; v < kMaxVertices; ++v) {
      if ((triangle >> v & 1) != 0) faces &= kVertexFaces[v];
    }
    for (int face = 0; face < 6; ++face) {
      if ((faces >> face & 1) == 0) continue;
      std::uint16_t beyond = 0;
      for (int v = 0; v < kMaxVertices; ++v) {
        if ((triangle >> v & 1) != 0) {
          beyond |= static_cast<std::uint16_t>(1u << VertexBeyond(v, face));
        }
      }
      EnterThrough(node.cell, face, beyond);
    }
  }

  // Enters the cell beyond a face through one of the face's triangles; triangle 0: through any of
  // them.
  void EnterThrough(const Vec3i& from, int face, std::uint16_t triangle) {
    const Vec3i beyond = Beyond(from, face);
    if (!cells_.HasCell(beyond)) {
      if (cells_.surface().IsFreeOutside()) Enter(Node{});
      return;
    }
    const FreshCell& cell = cells_.At(beyond);
    if (cell.free) Enter({beyond, Node::kBox});
    if (!cell.crossed) return;
    for (int t = 0; t < cell.parts.complex.tetrahedron_count; ++t) {
      const std::uint16_t mask = cell.parts.complex.vertex_mask[t];
      const bool through = triangle != 0 ? (mask & triangle) == triangle
                                         : HasTriangleOn(cell.parts.complex.vertices[t], face ^ 1);
      if (through) Enter({beyond, t});
    }
  }

  static bool HasTriangleOn(const std::array<std::uint8_t, 4>& vertices, int face) {
    return std::count_if(vertices.begin(), vertices.end(),
                         [&](int v) { return (kVertexFaces[v] >> face & 1) != 0; }) == 3;
  }

  FreshCells& cells_;
  const Vec3 centre_mm_;
  double reach_mm_ = 0.0;  // largest distance of a cell's middle from the centre
  Vec3 goal_mm_ = Vec3::Zero();
  std::priority_queue<std::pair<double, Node>, std::vector<std::pair<double, Node>>, Farther>
      queue_;
  std::unordered_set<std::uint64_t> seen_;
  bool reached_outside_ = false;
};

}  // namespace

FreePath FindFreePath(FreshCells& cells, const Vec3& from_mm, const Vec3& to_mm,
                      const Vec3& p_DHip_mm, int most_nodes) {
  const double radius_mm = (from_mm - p_DHip_mm).norm();
  Search forth(cells, p_DHip_mm, radius_mm);
  const std::vector<Node> start = forth.NodesAt(from_mm), goals = forth.NodesAt(to_mm);
  for (const Node& node : start) {
    if (std::find(goals.begin(), goals.end(), node) != goals.end()) return FreePath::kFound;
  }
  const FreePath found = forth.Run(start, goals, to_mm, most_nodes);
  if (found == FreePath::kFound || !forth.reached_outside()) return found;
  // The outside has too many neighbours to search through. So the search approaches the outside
  // from both sides.
  Search back(cells, p_DHip_mm, radius_mm);
  const FreePath outside = back.Run(goals, {Node{}}, from_mm, most_nodes);
  return outside == FreePath::kNone ? found : outside;
}

namespace {

// Densities are rounded by this share of them: where two corners are nearly as dense, that moves H
// between them by more than positions are rounded.
constexpr double kDensityRounding = 1e-15;

// A tetrahedron with the felt densities at its corners.
struct Part {
  std::array<Vec3, 4> corner;
  std::array<double, 4> density{};
};

// Adds the part of a tetrahedron in which sign * density <= sign * bound, as tetrahedra. H between
// two corners is put to the free side of its rounding.
void Cut(const Part& whole, double bound, double sign, std::vector<Part>& parts) {
  std::array<int, 4> order = {0, 1, 2, 3};  // corners within the bound first
  const auto inner = std::stable_partition(
      order.begin(), order.end(), [&](int n) { return sign * whole.density[n] <= sign * bound; });
  const auto within = inner - order.begin();
  if (within == 0) return;
  if (within == 4) return parts.push_back(whole);
  using Corner = std::pair<Vec3, double>;
  const auto at = [&](int n) { return Corner{whole.corner[order[n]], whole.density[order[n]]}; };
  const auto crossing = [&](int free, int other) {
    const auto [a, low] = at(free);
    const auto [b, high] = at(other);
    const double rounding = kDensityRounding * std::max(std::abs(low), std::abs(high));
    const double share = std::max(0.0, std::abs(bound - low) - rounding) / std::abs(high - low);
    return Corner{Vec3(a + share * (b - a)), bound};
  };
  const auto add = [&](const std::array<Corner, 4>& corners) {
    Part& part = parts.emplace_back();
    for (int n = 0; n < 4; ++n) std::tie(part.corner[n], part.density[n]) = corners[n];
  };
  // Between two triangles; a[n] and b[n] are the ends of an edge.
  const auto add_prism = [&](const std::array<Corner, 3>& a, const std::array<Corner, 3>& b) {
    add({a[0], a[1], a[2], b[0]});
    add({a[1], a[2], b[0], b[1]});
    add({a[2], b[0], b[1], b[2]});
  };
  if (within == 1) return add({at(0), crossing(0, 1), crossing(0, 2), crossing(0, 3)});
  if (within == 2) {
    return add_prism({at(0), crossing(0, 2), crossing(0, 3)},
                     {at(1), crossing(1, 2), crossing(1, 3)});
  }
  add_prism({at(0), at(1), at(2)}, {crossing(0, 3), crossing(1, 3), crossing(2, 3)});
}

// Squared distance from p to the free part of a tetrahedron.
double SquaredDistanceToFreePart(const HapticSurface& surface, const Vec3& p, const Part& whole) {
  std::vector<Part> below, free;
  Cut(whole, surface.isovalue, 1.0, below);
  for (const Part& part : below) Cut(part, surface.lower, -1.0, free);
  double nearest = std::numeric_limits<double>::infinity();
  for (const Part& part : free) {
    nearest = std::min(nearest, SquaredDistanceToTetrahedron(p, part.corner));
  }
  return nearest;
}

// True if a proxy on the border may leave the lattice because the HIP lies beyond the border by
// more than rounding.
bool MayLeave(const FreshCells& cells, const Vec3& p_LH, const Vec3& p_LHip) {
  const Vec3 last = cells.surface().lattice.size().cast<double>();
  for (int axis = 0; axis < 3; ++axis) {
    const double ahead = p_LHip[axis] - p_LH[axis];
    if (p_LH[axis] <= -1.0 + kHoldTolerance && ahead < -kHoldTolerance) return true;
    if (p_LH[axis] >= last[axis] - kHoldTolerance && ahead > kHoldTolerance) return true;
  }
  return false;
}

}  // namespace

double ApproachLeft(FreshCells& cells, const Vec3& p_DH_mm, const Vec3& p_DHip_mm,
                    double hold_tolerance) {
  const HapticSurface& surface = cells.surface();
  const double distance_mm = (p_DH_mm - p_DHip_mm).norm();
  const Vec3 p_LH = surface.X_LD.Apply(p_DH_mm);
  const Holders holders = cells.HoldersOf(p_LH);
  if (holders.outside && surface.IsFreeOutside() &&
      (holders.tetrahedra.empty() || MayLeave(cells, p_LH, surface.X_LD.Apply(p_DHip_mm)))) {
    return distance_mm;
  }
  double nearest_squared = distance_mm * distance_mm;
  for (const Holder& holder : holders.tetrahedra) {
    const double least = *std::min_element(holder.weight.begin(), holder.weight.end());
    if (!(least >= -hold_tolerance)) continue;
    const FreshCell& cell = cells.At(holder.cell);
    Part part{CornersOf(holder.cell, cell, holder.tetrahedron),
              DensitiesOf(cell, holder.tetrahedron)};
    for (Vec3& corner : part.corner) corner = surface.X_DL.Apply(corner);
    for (double& density : part.density) density *= surface.sign();
    nearest_squared =
        std::min(nearest_squared, SquaredDistanceToFreePart(surface, p_DHip_mm, part));
  }
  return distance_mm - std::sqrt(nearest_squared);
}

bool IsLocalMinimum(FreshCells& cells, const Vec3& p_DH_mm, const Vec3& p_DHip_mm) {
  const double tolerance_mm = std::max({kStickTolerance * (p_DH_mm - p_DHip_mm).norm(),
                                        kStickTolerancePerVoxel * cells.surface().voxel_mm,
                                        kStickTolerancePerPosition * p_DHip_mm.norm()});
  return ApproachLeft(cells, p_DH_mm, p_DHip_mm) <= tolerance_mm;
}

namespace {

constexpr int kTries = 600;
constexpr double kLongestTryMm = 0.2;
constexpr double kLeastGainMm = 0.002;  // twice the standoff

}  // namespace

bool ToolJudge::IsFree(const Vec3& p_mm) {
  return cells_.IsFree(cells_.HoldersOf(cells_.surface().X_LD.Apply(p_mm)).Density());
}

int ToolJudge::Falls(const ToolPose& from, const ToolPose& to) {
  cells_.Trim();
  int falls = 0;
  for (int n = 0; n < tool_.count; ++n) {
    const Vec3 a = BallAt(tool_, from, n), b = BallAt(tool_, to, n);
    for (int k = 1; k <= kPoints; ++k) falls += !IsFree(a + (b - a) * (1.0 * k / kPoints));
  }
  judged_ += static_cast<long>(tool_.count) * kPoints;
  return falls;
}

int ToolJudge::Falls(const ToolPose& from, const ToolPath& path) {
  int falls = 0;
  ToolPose last = from;
  for (int n = 0; n < path.count; ++n) {
    falls += Falls(last, path.pose[static_cast<std::size_t>(n)]);
    last = path.pose[static_cast<std::size_t>(n)];
  }
  return falls;
}

bool ToolJudge::IsFreeWay(const ToolPose& from, const ToolPose& to) {
  for (int n = 0; n < tool_.count; ++n) {
    const Vec3 a = BallAt(tool_, from, n), b = BallAt(tool_, to, n);
    for (int k = kPoints; k >= 1; --k) {  // the end is the likeliest to be blocked
      if (!IsFree(a + (b - a) * (1.0 * k / kPoints))) return false;
    }
  }
  return true;
}

double ToolJudge::Distance(const ToolPose& pose, const ToolPose& stylus) const {
  const Eigen::AngleAxisd turn(stylus.R_DS * pose.R_DS.conjugate());
  return std::hypot((stylus.p_DS_mm - pose.p_DS_mm).norm(),
                    tool_.rotation_length_mm * turn.angle());
}

double ToolJudge::NearerBySearch(std::mt19937_64& random, const ToolPose& rest,
                                 const ToolPose& stylus) {
  std::normal_distribution<double> normal;
  std::uniform_real_distribution<double> uniform;
  const auto vector = [&] { return Vec3(normal(random), normal(random), normal(random)); };
  cells_.Trim();
  ToolPose at = rest;
  double left_mm = Distance(rest, stylus);
  for (int n = 0; n < kTries; ++n) {
    const double size_mm = kLongestTryMm * std::pow(10.0, -3.0 * uniform(random));
    const double back = 0.02 * uniform(random);
    const Vec3 turn_rad = size_mm / tool_.rotation_length_mm * vector();
    ToolPose next{at.p_DS_mm + size_mm * vector() + back * (stylus.p_DS_mm - at.p_DS_mm),
                  Eigen::AngleAxisd(turn_rad.norm(), turn_rad.normalized()) * at.R_DS};
    next.R_DS = next.R_DS.slerp(back, stylus.R_DS);
    if (Distance(next, stylus) > left_mm - kLeastGainMm || !IsFreeWay(at, next)) continue;
    at = next;
    left_mm = Distance(at, stylus);
  }
  return Distance(rest, stylus) - left_mm;
}

}  // namespace palpate::lab
