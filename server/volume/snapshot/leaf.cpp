#include "server/volume/snapshot/leaf.h"

#include <openvdb/tree/LeafNode.h>

#include <algorithm>
#include <cstring>
#include <utility>

#include "server/volume/snapshot/brick_memory.h"

namespace palpate {
namespace {

// A heap block has eight bytes of overhead, and its size is a multiple of 16.
constexpr std::uint64_t HeapBytes(std::size_t bytes) { return (bytes + 8 + 15) / 16 * 16; }

// __restrict, because bytes may be part of anything: the compiler would convert them one by one.
template <class From, class To>
void Copy(const From* __restrict from, To* __restrict to) noexcept {
  for (int n = 0; n < kBrickVoxels; ++n) to[n] = static_cast<To>(from[n]);
}

template <class T>
std::unique_ptr<Leaf::Node<T>> NodeOf(const Brick& values) {
  auto node = std::make_unique<Leaf::Node<T>>(openvdb::Coord(0, 0, 0), T(), true);
  Copy(values.data(), node->buffer().data());
  return node;
}

}  // namespace

template <class T>
LeafPtr Leaf::Take(std::unique_ptr<Node<T>> node) {
  static_assert(Node<T>::SIZE == kBrickVoxels, "a brick is a leaf");
  const T* const values = std::as_const(*node).buffer().data();
  LeafPtr leaf(new Leaf(kLeafTypeOf<T>, node.get(), values));
  node.release();
  return leaf;
}

template LeafPtr Leaf::Take(std::unique_ptr<Node<std::uint8_t>>);
template LeafPtr Leaf::Take(std::unique_ptr<Node<std::int16_t>>);
template LeafPtr Leaf::Take(std::unique_ptr<Node<std::uint16_t>>);
template LeafPtr Leaf::Take(std::unique_ptr<Node<float>>);

Leaf::Leaf(LeafType type, void* node, const void* values) noexcept
    : values_(values), node_(node), type_(type) {
  AddBrickBytes(Bytes());
}

Leaf::~Leaf() {
  SubtractBrickBytes(Bytes());
  VisitType(type_, [this](auto voxel) { delete static_cast<Node<decltype(voxel)>*>(node_); });
}

LeafPtr Leaf::Of(LeafType type, const Brick& values) {
  return VisitType(type, [&](auto voxel) { return Take(NodeOf<decltype(voxel)>(values)); });
}

LeafPtr Leaf::Constant(LeafType type, float value, bool is_active) {
  Brick values;
  values.fill(value);
  LeafPtr leaf = VisitType(type, [&](auto voxel) {
    auto node = NodeOf<decltype(voxel)>(values);
    node->setValueMask(openvdb::util::NodeMask<3>(is_active));
    return Take(std::move(node));
  });
  const_cast<Leaf&>(*leaf).is_constant_ = true;  // no other owner yet
  return leaf;
}

LeafPtr Leaf::Smallest(const Brick& values) {
  const auto type = std::find_if(std::begin(kLeafTypes), std::end(kLeafTypes),
                                 [&](LeafType candidate) { return Holds(candidate, values); });
  return Of(*type, values);
}

LeafPtr Leaf::With(const Brick& values) const {
  const LeafType type = Holds(type_, values) ? type_ : LeafType::kFloat;
  const bool is_all_active = VisitType(type_, [this](auto voxel) {
    return static_cast<const Node<decltype(voxel)>*>(node_)->valueMask().isOn();
  });
  return VisitType(type, [&](auto voxel) {
    auto node = NodeOf<decltype(voxel)>(values);
    // A shortcut: most leaves are all active, and an edit makes many leaves.
    if (is_all_active) return Take(std::move(node));
    for (int n = 0; n < kBrickVoxels; ++n) {
      const auto place = static_cast<openvdb::Index>(n);
      if (values[n] == (*this)[place] && !IsActive(place)) node->setValueOff(place);
    }
    return Take(std::move(node));
  });
}

void Leaf::CopyTo(float* out) const noexcept {
  VisitType(type_, [&](auto voxel) { Copy(values<decltype(voxel)>(), out); });
}

Brick Leaf::Floats() const noexcept {
  Brick floats;
  CopyTo(floats.data());
  return floats;
}

bool Leaf::IsActive(std::size_t n) const noexcept {
  return VisitType(type_, [&](auto voxel) {
    return static_cast<const Node<decltype(voxel)>*>(node_)->isValueOn(
        static_cast<openvdb::Index>(n));
  });
}

std::uint64_t Leaf::Bytes(LeafType type) noexcept {
  return HeapBytes(sizeof(Leaf)) + VisitType(type, [](auto voxel) {
           return HeapBytes(sizeof(Node<decltype(voxel)>)) +
                  HeapBytes(sizeof(voxel) * kBrickVoxels);
         });
}

bool HaveSameValues(const Leaf& one, const Leaf& other) noexcept {
  return &one == &other || one.Floats() == other.Floats();
}

bool HaveSameBits(const Leaf& one, const Leaf& other) noexcept {
  const Brick a = one.Floats(), b = other.Floats();
  return std::memcmp(a.data(), b.data(), sizeof(Brick)) == 0;
}

bool Holds(LeafType type, const Brick& values) noexcept {
  if (type == LeafType::kFloat) return true;
  return std::all_of(values.begin(), values.end(),
                     [type](float value) { return Holds(type, value); });
}

}  // namespace palpate
