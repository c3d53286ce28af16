#include "server/volume/brick_directory.h"

#include <algorithm>
#include <cassert>
#include <map>
#include <utility>

namespace palpate {
namespace {

Vec3i CountOf(const Vec3i& size, int edge) { return ((size.array() + (edge - 1)) / edge).matrix(); }

// The counts of the shared_ptr and of the heap come to about 32 bytes.
constexpr std::uint64_t kBytesPerBrick = sizeof(Brick) + 32;

}  // namespace

BrickDirectory::BrickDirectory(const Vec3i& size_voxels,
                               const std::function<BrickPtr(const Vec3i& brick)>& values)
    : brick_count_(CountOf(size_voxels, kBrickEdge)), node_count_(CountOf(brick_count_, 8)) {
  std::vector<std::shared_ptr<Node>> nodes(static_cast<std::size_t>(node_count_.x()) *
                                           node_count_.y() * node_count_.z());
  for (auto& node : nodes) {
    node = std::make_shared<Node>();
    node->newest = 1;
    node->revisions.fill(1);
  }
  Vec3i brick;
  for (brick.x() = 0; brick.x() < brick_count_.x(); ++brick.x()) {
    for (brick.y() = 0; brick.y() < brick_count_.y(); ++brick.y()) {
      for (brick.z() = 0; brick.z() < brick_count_.z(); ++brick.z()) {
        BrickPtr made = values(brick);
        assert(made != nullptr);
        hash_ += HashOfBrick(*made, NumberOf(brick));
        nodes[NodeOf(brick)]->bricks[PlaceInNode(brick)] = std::move(made);
      }
    }
  }
  nodes_.assign(nodes.begin(), nodes.end());
}

BrickDirectory BrickDirectory::With(std::span<const BrickChange> changes,
                                    std::uint64_t revision) const {
  BrickDirectory changed = *this;
  std::map<std::size_t, std::shared_ptr<Node>> copies;
  for (const BrickChange& change : changes) {
    const std::size_t place = PlaceInNode(change.brick);
    std::shared_ptr<Node>& copy = copies[NodeOf(change.brick)];
    if (!copy) copy = std::make_shared<Node>(*nodes_[NodeOf(change.brick)]);
    const std::uint64_t number = NumberOf(change.brick);
    changed.hash_ -= HashOfBrick(*copy->bricks[place], number);
    changed.hash_ += HashOfBrick(*change.values, number);
    copy->bricks[place] = change.values;
    copy->revisions[place] = copy->newest = revision;
  }
  for (auto& [node, copy] : copies) changed.nodes_[node] = std::move(copy);
  return changed;
}

BrickDirectory BrickDirectory::AllChangedAt(std::uint64_t revision) const {
  BrickDirectory changed = *this;
  for (auto& node : changed.nodes_) {
    auto copy = std::make_shared<Node>(*node);
    copy->newest = revision;
    copy->revisions.fill(revision);
    node = std::move(copy);
  }
  return changed;
}

void BrickDirectory::ForEachBrickOfNodes(
    const std::function<bool(std::size_t node)>& wanted,
    const std::function<void(std::size_t node, int place, const Vec3i& brick)>& visit) const {
  std::size_t n = 0;
  Vec3i node;
  for (node.x() = 0; node.x() < node_count_.x(); ++node.x()) {
    for (node.y() = 0; node.y() < node_count_.y(); ++node.y()) {
      for (node.z() = 0; node.z() < node_count_.z(); ++node.z(), ++n) {
        if (!wanted(n)) continue;
        for (int place = 0; place < kBrickVoxels; ++place) {
          if (!nodes_[n]->bricks[place]) continue;
          visit(n, place, node * 8 + Vec3i(place >> 6, place >> 3 & 7, place & 7));
        }
      }
    }
  }
}

std::vector<BrickChange> BrickDirectory::ChangesTo(const BrickDirectory& other) const {
  assert(other.brick_count_ == brick_count_);
  std::vector<BrickChange> changes;
  ForEachBrickOfNodes([&](std::size_t node) { return nodes_[node] != other.nodes_[node]; },
                      [&](std::size_t node, int place, const Vec3i& brick) {
                        const BrickPtr& from = nodes_[node]->bricks[place];
                        const BrickPtr& to = other.nodes_[node]->bricks[place];
                        if (from != to && *from != *to) changes.push_back({brick, to});
                      });
  return changes;
}

const BrickPtr& BrickDirectory::At(const Vec3i& brick) const {
  return nodes_[NodeOf(brick)]->bricks[PlaceInNode(brick)];
}

std::vector<std::uint64_t> BrickDirectory::ChangedSince(std::uint64_t revision) const {
  std::vector<std::uint64_t> numbers;
  ForEachBrickOfNodes([&](std::size_t node) { return nodes_[node]->newest > revision; },
                      [&](std::size_t node, int place, const Vec3i& brick) {
                        if (nodes_[node]->revisions[place] > revision) {
                          numbers.push_back(NumberOf(brick));
                        }
                      });
  std::sort(numbers.begin(), numbers.end());
  return numbers;
}

std::uint64_t BrickDirectory::MemoryBytes() const {
  std::vector<const Brick*> bricks;
  for (const auto& node : nodes_) {
    for (const BrickPtr& brick : node->bricks) {
      if (brick && (bricks.empty() || bricks.back() != brick.get())) bricks.push_back(brick.get());
    }
  }
  std::sort(bricks.begin(), bricks.end());
  const auto end = std::unique(bricks.begin(), bricks.end());
  return static_cast<std::uint64_t>(end - bricks.begin()) * kBytesPerBrick +
         nodes_.size() * sizeof(Node);
}

std::uint64_t BrickDirectory::MemoryBytes(const Vec3i& size_voxels) {
  const Vec3i bricks = CountOf(size_voxels, kBrickEdge);
  return static_cast<std::uint64_t>(bricks.cast<std::int64_t>().prod()) * kBytesPerBrick +
         static_cast<std::uint64_t>(CountOf(bricks, 8).cast<std::int64_t>().prod()) * sizeof(Node);
}

}  // namespace palpate
