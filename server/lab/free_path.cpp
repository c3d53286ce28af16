#include "server/lab/free_path.h"

#include <algorithm>
#include <cstdint>
#include <queue>
#include <unordered_set>
#include <utility>
#include <vector>

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

}  // namespace palpate::lab
