#include "server/volume/save/volume_pipe.h"

#include <openvdb/tree/LeafNode.h>

#include <algorithm>
#include <cstring>
#include <iterator>
#include <memory>
#include <utility>
#include <vector>

#include "common/error/error.h"
#include "server/volume/load/handover.h"
#include "server/volume/snapshot/grid_tree.h"

namespace palpate {
namespace {

constexpr std::size_t kBytesAtOnce = 64 << 10;

void Put(const void* data, std::size_t size, std::string& out) {
  out.append(static_cast<const char*>(data), size);
}
template <class T>
void Put(const T& value, std::string& out) {
  Put(&value, sizeof value, out);
}

void PutLeaf(const Leaf& leaf, std::string& out) {
  Put(PipedLeaf{.type = static_cast<std::uint8_t>(leaf.type()),
                .is_constant = leaf.is_constant(),
                .is_active = leaf.IsActive(0),
                .reserved = 0,
                .value = leaf[0]},
      out);
  if (leaf.is_constant()) return;
  std::uint64_t states[kBrickVoxels / 64] = {};
  for (std::size_t n = 0; n < kBrickVoxels; ++n) {
    states[n / 64] |= std::uint64_t{leaf.IsActive(n)} << n % 64;
  }
  Put(states, out);
  VisitType(leaf.type(), [&](auto voxel) {
    Put(leaf.values<decltype(voxel)>(), kBrickVoxels * sizeof voxel, out);
  });
}

std::string EntriesOf(const GridForm& form) {
  std::string bytes;
  for (const GridEntry& entry : form.entries) {
    Put(HandoverEntry{static_cast<std::uint32_t>(entry.type - kGridEntryTypes),
                      static_cast<std::uint32_t>(entry.name.size()),
                      static_cast<std::uint32_t>(entry.bytes.size())},
        bytes);
    bytes += entry.name + entry.bytes;
  }
  return bytes;
}

template <std::size_t kSize>
std::uint32_t NumberIn(const std::string_view (&names)[kSize], std::string_view name) {
  return static_cast<std::uint32_t>(std::ranges::find(names, name) - names);
}

HandoverTree TreeOf(const GridForm& form, std::size_t entry_bytes) {
  HandoverTree tree{};
  for (int axis = 0; axis < 3; ++axis) tree.first[axis] = form.first[axis];
  tree.background = form.background;
  tree.map = NumberIn(kGridMaps, form.map);
  std::ranges::copy(form.matrix, tree.matrix);
  tree.entry_bytes = entry_bytes;
  tree.top_nodes = form.top_nodes.size();
  tree.tiles = form.tiles.size();
  tree.nodes = form.nodes.size();
  tree.leaves = form.outer_leaves.size();
  return tree;
}

void PutForm(const GridForm& form, const std::string& entries, std::string& out) {
  out += entries;
  for (const Vec3i& first : form.top_nodes) Put(first, out);
  for (const GridTile& tile : form.tiles) {
    const Vec3i& at = tile.first;
    Put(HandoverTile{{at.x(), at.y(), at.z()}, tile.edge, tile.value, tile.is_active}, out);
  }
  for (const Vec3i& first : form.nodes) Put(first, out);
  for (const GridLeaf& leaf : form.outer_leaves) {
    Put(leaf.first, out);
    PutLeaf(*leaf.leaf, out);
  }
}

void Read(std::FILE* in, void* data, std::size_t size) {
  if (std::fread(data, 1, size, in) == size) return;
  throw Error(ErrorKind::kInternal, "palpated has ended; nothing was saved");
}
template <class T>
T Read(std::FILE* in) {
  T value;
  Read(in, &value, sizeof value);
  return value;
}

std::string ReadText(std::FILE* in, std::size_t size) {
  std::string text(size, '\0');
  Read(in, text.data(), size);
  return text;
}

GridForm ReadForm(std::FILE* in, const HandoverTree& tree) {
  GridForm form;
  form.first = Vec3i(tree.first);
  form.type = kGridTypes[tree.grid_type];
  form.background = tree.background;
  if (tree.map < std::size(kGridMaps)) form.map = kGridMaps[tree.map];
  std::ranges::copy(tree.matrix, form.matrix.begin());
  for (std::uint64_t bytes = 0; bytes < tree.entry_bytes;) {
    const auto entry = Read<HandoverEntry>(in);
    std::string name = ReadText(in, entry.name_bytes);
    form.entries.push_back(
        {std::move(name), &kGridEntryTypes[entry.type], ReadText(in, entry.value_bytes)});
    bytes += sizeof entry + entry.name_bytes + entry.value_bytes;
  }
  const auto read_places = [in](std::uint64_t count, std::vector<Vec3i>& places) {
    for (; count > 0; --count) places.push_back(Read<Vec3i>(in));
  };
  read_places(tree.top_nodes, form.top_nodes);
  for (std::uint64_t n = 0; n < tree.tiles; ++n) {
    const auto tile = Read<HandoverTile>(in);
    form.tiles.push_back({Vec3i(tile.first), tile.edge, tile.value, tile.is_active != 0});
  }
  read_places(tree.nodes, form.nodes);
  for (std::uint64_t n = 0; n < tree.leaves; ++n) {
    const Vec3i first = Read<Vec3i>(in);
    form.outer_leaves.push_back({first, ReceiveLeaf(in)});
  }
  return form;
}

}  // namespace

VolumeSender::VolumeSender(const BrickDirectory& bricks, const VolumeMetadata& metadata)
    : bricks_(bricks),
      count_(static_cast<std::uint64_t>(bricks.brick_count().cast<std::int64_t>().prod())) {
  HandoverHeader header = MakeHandoverHeader(metadata, LeafType::kFloat);
  const GridForm* const form = metadata.grid_form.get();
  const std::string entries = form ? EntriesOf(*form) : "";
  if (form) {
    header.form = static_cast<std::uint32_t>(HandoverForm::kTree);
    const std::uint32_t is_level_set = header.tree.is_level_set;
    header.tree = TreeOf(*form, entries.size());
    header.tree.is_level_set = is_level_set;
  }
  header.tree.grid_type = NumberIn(kGridTypes, GridTypeOf(bricks, metadata));
  Put(header, bytes_);
  if (form) PutForm(*form, entries, bytes_);
}

std::string_view VolumeSender::Next() {
  // The first bytes are there already.
  if (std::exchange(is_begun_, true)) bytes_.clear();
  for (; next_ < count_ && bytes_.size() < kBytesAtOnce; ++next_) {
    PutLeaf(*bricks_.At(bricks_.BrickOf(next_)), bytes_);
  }
  return bytes_;
}

ReceivedVolume ReceiveVolume(std::FILE* in) {
  const auto header = Read<HandoverHeader>(in);
  if (std::memcmp(header.magic, HandoverHeader::kMagic, sizeof header.magic) != 0) {
    throw Error(ErrorKind::kFailedPrecondition,
                "palpated is of another version than palpate-import: start it again");
  }
  ReceivedVolume volume{MetadataOf(header), kGridTypes[header.tree.grid_type]};
  if (static_cast<HandoverForm>(header.form) == HandoverForm::kTree) {
    volume.metadata.grid_form = std::make_shared<const GridForm>(ReadForm(in, header.tree));
  }
  return volume;
}

LeafPtr ReceiveLeaf(std::FILE* in) {
  const auto leaf = Read<PipedLeaf>(in);
  const auto type = static_cast<LeafType>(leaf.type);
  if (leaf.is_constant) return Leaf::Constant(type, leaf.value, leaf.is_active);
  openvdb::util::NodeMask<3> states;
  for (openvdb::Index n = 0; n < kBrickVoxels / 64; ++n) {
    states.getWord<std::uint64_t>(n) = Read<std::uint64_t>(in);
  }
  return VisitType(type, [&](auto voxel) {
    using T = decltype(voxel);
    auto node = std::make_unique<Leaf::Node<T>>(openvdb::Coord(0, 0, 0), T(), false);
    Read(in, node->buffer().data(), kBrickVoxels * sizeof voxel);
    node->setValueMask(states);
    return Leaf::Take(std::move(node));
  });
}

}  // namespace palpate
