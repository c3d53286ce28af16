#include <openvdb/io/Stream.h>

#include <algorithm>
#include <array>
#include <cstdint>
#include <filesystem>
#include <fstream>
#include <limits>
#include <memory>
#include <optional>
#include <string>
#include <string_view>
#include <type_traits>
#include <utility>
#include <vector>

#include "common/error/error.h"
#include "server/import/image_header.h"
#include "server/import/readers.h"
#include "server/import/tree_writer.h"
#include "server/import/value_checks.h"
#include "server/volume/load/handover.h"
#include "server/volume/snapshot/openvdb_grids.h"

namespace palpate {
namespace {

// Chooses the grid of a .vdb file to read.
//
// Threads: one. Errors: palpate::Error without the file's name.
//
// The user's choice. Empty: the only grid.
struct GridChoice {
  std::string name{};       // the grid's; NAME[K] is the K-th of several grids with this name
  std::string component{};  // for a grid of vectors: magnitude, x, y or z
};

struct NamedGrid {
  std::string name;  // unique
  openvdb::GridBase::Ptr grid;
};

std::vector<NamedGrid> ReadGrids(const std::filesystem::path& path) {
  std::ifstream in(path, std::ios::binary);
  // Without exceptions, a truncated file would be read as if zeros followed.
  in.exceptions(std::ios::badbit | std::ios::failbit);
  openvdb::io::Stream stream(in, /*delayLoad=*/false);
  std::vector<NamedGrid> grids;
  for (const openvdb::GridBase::Ptr& grid : *stream.getGrids()) {
    if (grid) grids.push_back({grid->getName(), grid});
  }
  for (std::size_t n = 0; n < grids.size(); ++n) {
    const std::string name = grids[n].grid->getName();
    const auto is_so_named = [&](const NamedGrid& one) { return one.grid->getName() == name; };
    if (std::count_if(grids.begin(), grids.end(), is_so_named) < 2) continue;
    const auto before =
        std::count_if(grids.begin(), grids.begin() + static_cast<std::ptrdiff_t>(n), is_so_named);
    grids[n].name += '[' + std::to_string(before) + ']';
  }
  return grids;
}

bool HasVectors(const openvdb::GridBase& grid) {
  return grid.isType<openvdb::Vec3SGrid>() || grid.isType<openvdb::Vec3DGrid>() ||
         grid.isType<openvdb::Vec3IGrid>();
}

// For example: "surface" (level set, float), ...
std::string List(const std::vector<NamedGrid>& grids) {
  std::string list;
  for (const auto& [name, grid] : grids) {
    const openvdb::GridClass of = grid->getGridClass();
    if (!list.empty()) list += ", ";
    list += Quoted(name) + " (" + (of == openvdb::GRID_LEVEL_SET ? "level set, " : "") +
            grid->valueType() + ")";
  }
  return list;
}

const NamedGrid& Chosen(const std::vector<NamedGrid>& grids, const std::string& name) {
  if (grids.empty()) Refuse("there is no grid in the file");
  if (name.empty()) {
    if (grids.size() == 1) return grids[0];
    Refuse("there are " + std::to_string(grids.size()) +
           " grids; choose one with --grid NAME: " + List(grids));
  }
  const auto found = std::find_if(grids.begin(), grids.end(),
                                  [&](const NamedGrid& grid) { return grid.name == name; });
  if (found == grids.end())
    Refuse("there is no grid " + Quoted(name) + "; there are " + List(grids));
  return *found;
}

constexpr std::string_view kComponents[] = {"magnitude", "x", "y", "z"};

template <class Vector>
float ComponentOf(const Vector& vector, std::ptrdiff_t component) {
  if (component > 0) return static_cast<float>(vector[static_cast<int>(component) - 1]);
  return static_cast<float>(openvdb::Vec3d(vector).length());
}

template <class VectorGrid>
openvdb::GridBase::Ptr Scalars(const openvdb::GridBase::Ptr& grid, std::ptrdiff_t component) {
  const VectorGrid& from = *openvdb::gridPtrCast<VectorGrid>(grid);
  const auto to = openvdb::FloatGrid::create(std::make_shared<openvdb::FloatTree>(
      from.tree(), ComponentOf(from.background(), component), openvdb::TopologyCopy()));
  to->setTransform(from.transform().copy());
  to->setName(from.getName());
  openvdb::FloatGrid::Accessor out = to->getAccessor();
  for (auto value = from.cbeginValueAll(); value; ++value) {
    const float is = ComponentOf(value.getValue(), component);
    if (value.isVoxelValue()) {
      out.setValueOnly(value.getCoord(), is);
    } else {
      out.addTile(value.getLevel(), value.getCoord(), is, value.isValueOn());
    }
  }
  return to;
}

openvdb::GridBase::Ptr ComponentOfGrid(const NamedGrid& named, const std::string& component) {
  const auto found = std::find(std::begin(kComponents), std::end(kComponents), component);
  if (found == std::end(kComponents)) {
    Refuse("the grid " + Quoted(named.name) +
           " holds vectors; choose what is felt with --component magnitude, x, y or z");
  }
  const std::ptrdiff_t number = found - std::begin(kComponents);
  const openvdb::GridBase::Ptr& grid = named.grid;
  if (grid->isType<openvdb::Vec3SGrid>()) return Scalars<openvdb::Vec3SGrid>(grid, number);
  if (grid->isType<openvdb::Vec3DGrid>()) return Scalars<openvdb::Vec3DGrid>(grid, number);
  return Scalars<openvdb::Vec3IGrid>(grid, number);
}

// Returns a grid of scalars: float, double, int32, int64 or bool. Throws kInvalidArgument if the
// file is no .vdb file, or if the choice does not exist; the message then lists the choices.
openvdb::GridBase::Ptr ReadChosenGrid(const std::filesystem::path& path, const GridChoice& choice) {
  openvdb::initialize();
  std::vector<NamedGrid> grids;
  try {
    grids = ReadGrids(path);
  } catch (const std::ios_base::failure&) {
    Refuse("this is no complete .vdb file; copy or download it again");
  } catch (const openvdb::Exception& error) {
    Refuse(std::string("this is no .vdb file that can be read (") + error.what() + ")");
  } catch (const std::length_error&) {
    Refuse("the .vdb file is damaged; copy or download it again");
  }
  const NamedGrid& chosen = Chosen(grids, choice.name);
  if (HasVectors(*chosen.grid)) return ComponentOfGrid(chosen, choice.component);
  if (!choice.component.empty()) {
    Refuse("the grid " + Quoted(chosen.name) + " holds scalars, which have no component");
  }
  return chosen.grid;
}

// OpenVDB multiplies a row vector by a matrix on its right.
void CopyGeometry(const openvdb::math::Transform& transform, const Vec3i& first,
                  VolumeMetadata* metadata) {
  if (!transform.isLinear()) Refuse("the grid's transform is not linear; resample it first");
  const openvdb::Mat4d matrix = transform.baseMap()->getAffineMap()->getMat4();
  for (int col = 0; col < 3; ++col) {
    Vec3 step;
    for (int row = 0; row < 3; ++row) step[row] = matrix(col, row);
    metadata->spacing_mm[col] = step.norm();
    CheckSpacing(metadata->spacing_mm[col]);
    metadata->direction.col(col) = step / step.norm();
  }
  const openvdb::Vec3d origin =
      transform.indexToWorld(openvdb::Vec3d(first.x(), first.y(), first.z()));
  metadata->origin_W_mm = {origin.x(), origin.y(), origin.z()};
}

void KeepMap(const openvdb::math::Transform& transform, GridForm* form) {
  const std::string type = transform.mapType();
  for (const std::string_view map : kGridMaps) {
    if (map == type) form->map = map;
  }
  const openvdb::Mat4d matrix = transform.baseMap()->getAffineMap()->getMat4();
  std::copy_n(matrix.asPointer(), form->matrix.size(), form->matrix.begin());
}

template <class T>
std::string BytesOf(const openvdb::Metadata& metadata) {
  const T value = static_cast<const openvdb::TypedMetadata<T>&>(metadata).value();
  return {reinterpret_cast<const char*>(&value), sizeof value};
}

// In the order of kGridEntryTypes.
constexpr std::string (*kBytesOf[])(const openvdb::Metadata& metadata) = {
    [](const openvdb::Metadata& metadata) {
      return static_cast<const openvdb::StringMetadata&>(metadata).value();
    },
    BytesOf<bool>,
    BytesOf<openvdb::Int32>,
    BytesOf<openvdb::Int64>,
    BytesOf<float>,
    BytesOf<double>,
    BytesOf<openvdb::Vec2i>,
    BytesOf<openvdb::Vec2s>,
    BytesOf<openvdb::Vec2d>,
    BytesOf<openvdb::Vec3i>,
    BytesOf<openvdb::Vec3s>,
    BytesOf<openvdb::Vec3d>,
    BytesOf<openvdb::Vec4i>,
    BytesOf<openvdb::Vec4s>,
    BytesOf<openvdb::Vec4d>,
    BytesOf<openvdb::Mat4s>,
    BytesOf<openvdb::Mat4d>,
};
static_assert(std::size(kBytesOf) == std::size(kGridEntryTypes));

void KeepEntries(const openvdb::MetaMap& map, GridForm* form, Reporter* reporter) {
  std::size_t bytes = 0;
  for (auto entry = map.beginMeta(); entry != map.endMeta(); ++entry) {
    const std::string& name = entry->first;
    // These entries are written anew with each file.
    if (name.starts_with("file_") || name.starts_with("palpate_")) continue;
    const openvdb::Metadata& value = *entry->second;
    const auto* const type =
        std::find_if(std::begin(kGridEntryTypes), std::end(kGridEntryTypes),
                     [&](const GridEntryType& one) { return one.name == value.typeName(); });
    const std::size_t needed = sizeof(HandoverEntry) + name.size() + value.size();
    if (type == std::end(kGridEntryTypes) || bytes + needed > kMostEntryBytes) {
      reporter->Warn("the grid's entry " + Quoted(name) + " (" + value.typeName() +
                     ") is not kept; it will be missing when the volume is saved");
      continue;
    }
    bytes += needed;
    form->entries.push_back({name, type, kBytesOf[type - kGridEntryTypes](value)});
  }
}

struct Box {
  Vec3i first;
  std::array<std::int64_t, 3> size;
};

// The box that palpated's own files record.
std::optional<Box> OwnBox(const openvdb::GridBase& grid, const openvdb::CoordBBox& active) {
  const auto size = grid.getMetadata<openvdb::Vec3IMetadata>("palpate_size");
  if (!size) return std::nullopt;
  const auto first = grid.getMetadata<openvdb::Vec3IMetadata>("palpate_first");
  Box box{Vec3i::Zero(), {}};
  for (int k = 0; k < 3; ++k) {
    if (first) box.first[k] = first->value()[k];
    box.size[static_cast<std::size_t>(k)] = size->value()[k];
    const std::int64_t end = std::int64_t{box.first[k]} + size->value()[k];
    const bool holds = active.empty() || (box.first[k] <= active.min()[k] && active.max()[k] < end);
    if (!holds || box.first[k] % kBrickEdge != 0) return std::nullopt;
  }
  return box;
}

// Rounds the active box out to whole leaves, so that a leaf of OpenVDB becomes one leaf here.
Box BoxOf(const openvdb::GridBase& grid) {
  const openvdb::CoordBBox active = grid.evalActiveVoxelBoundingBox();
  if (const auto own = OwnBox(grid, active)) return *own;
  if (active.empty()) Refuse("the grid has no active voxels; there is nothing to feel");
  Box box{};
  for (int k = 0; k < 3; ++k) {
    box.first[k] = active.min()[k] & -kBrickEdge;
    // Not dim(): a box may be larger than dim()'s 32 bits hold.
    const std::int64_t last = active.max()[k] | (kBrickEdge - 1);
    box.size[static_cast<std::size_t>(k)] = last - box.first[k] + 1;
  }
  return box;
}

void CopyOwnEntries(const openvdb::GridBase& grid, VolumeMetadata* metadata) {
  for (const auto& [name, text] : {std::pair("palpate_unit", &metadata->unit),
                                   std::pair("palpate_original_type", &metadata->original_type)}) {
    const auto entry = grid.getMetadata<openvdb::StringMetadata>(name);
    if (entry) *text = entry->value();
  }
  const auto axes = grid.getMetadata<openvdb::StringMetadata>("palpate_patient_axes");
  if (axes && IsPatientAxes(axes->value())) metadata->patient_axes = axes->value();
  const auto frames = grid.getMetadata<openvdb::Int32Metadata>("palpate_frames");
  if (frames) metadata->frames = frames->value();
}

// Converts a type of kGridTypes to the type name of messages and of other formats.
std::string OriginalType(std::string_view grid_type) {
  if (grid_type == "float") return "float32";
  return grid_type == "double" ? "float64" : std::string(grid_type);
}

// What palpated saved was judged when it was loaded.
bool IsOwn(const openvdb::GridBase& grid) {
  return grid.getMetadata<openvdb::Vec3IMetadata>("palpate_size") != nullptr;
}

// Looks in some leaves at voxels beside which the sign changes.
template <class Tree>
DistanceCheck::Verdict LookForDistances(const Tree& tree, const Vec3i& size, const Vec3i& first,
                                        const Vec3& voxel_size) {
  constexpr openvdb::Index64 kMostLeaves = 2000;
  constexpr int kMostSteps = 16;
  constexpr int kFarthest = 1 << 30;
  DistanceCheck check;
  openvdb::tree::ValueAccessor<const Tree> at(tree);
  const auto value = [&at](const openvdb::Coord& voxel) {
    return static_cast<float>(at.getValue(voxel));
  };
  const openvdb::Index64 every = tree.leafCount() / kMostLeaves + 1;
  openvdb::Index64 number = 0;
  for (auto leaf = tree.cbeginLeaf(); leaf; ++leaf) {
    const openvdb::Coord& o = leaf->origin();
    const auto [lowest, highest] = std::minmax({o.x(), o.y(), o.z()});
    if (number++ % every != 0 || lowest < -kFarthest || highest > kFarthest) continue;
    for (auto voxel = leaf->cbeginValueAll(); voxel; ++voxel) {
      const openvdb::Coord c = voxel.getCoord();
      if ((value(c) < 0.0f) == (value(c.offsetBy(1, 0, 0)) < 0.0f)) continue;
      check.AddGradient(0.5 * Vec3(value(c.offsetBy(1, 0, 0)) - value(c.offsetBy(-1, 0, 0)),
                                   value(c.offsetBy(0, 1, 0)) - value(c.offsetBy(0, -1, 0)),
                                   value(c.offsetBy(0, 0, 1)) - value(c.offsetBy(0, 0, -1))));
    }
  }
  const auto background = static_cast<float>(tree.background());
  if (background != 0.0f) {
    check.AddOutside(background);
    return check.Judge(voxel_size);
  }
  const Vec3i last = size - Vec3i::Ones(), step = (last / kMostSteps).cwiseMax(1);
  for (int x = 0; x <= last.x(); x += step.x()) {
    for (int y = 0; y <= last.y(); y += step.y()) {
      for (const int z : {0, last.z()}) {
        const Vec3i voxel = first + Vec3i(x, y, z);
        const openvdb::Coord c(voxel.x(), voxel.y(), voxel.z());
        if (at.isValueOn(c)) check.AddOutside(value(c));
      }
    }
  }
  return check.Judge(voxel_size);
}

// Does the file say rightly, or not at all, that the values are distances, negative inside?
template <class Grid>
bool IsFeltAsLevelSet(const Grid& grid, const VolumeMetadata& metadata, const Vec3i& first,
                      Reporter* reporter) {
  if constexpr (!std::is_floating_point_v<typename Grid::ValueType>) return metadata.is_level_set;
  const openvdb::GridClass is = grid.getGridClass();
  if (is == openvdb::GRID_UNKNOWN) {
    const openvdb::Vec3d v = grid.voxelSize();  // whatever the user says that it is in mm
    return IsLevelSet(LookForDistances(grid.tree(), metadata.size, first, {v.x(), v.y(), v.z()}),
                      reporter);
  }
  if (is != openvdb::GRID_LEVEL_SET || grid.background() > 0) return metadata.is_level_set;
  reporter->Warn(
      std::string("the file calls its values a level set, whose outside is positive, and they are "
                  "not positive outside: they are felt as other values are, from the lower ones") +
      kReadOtherwise);
  return false;
}

template <class Grid>
bool Write(const openvdb::GridBase::Ptr& grid, VolumeMetadata metadata, const GridForm& form,
           int fd, Reporter* reporter) {
  if (!grid->isType<Grid>()) return false;
  if (!IsOwn(*grid)) {
    metadata.is_level_set =
        IsFeltAsLevelSet(*openvdb::gridPtrCast<Grid>(grid), metadata, form.first, reporter);
  }
  WriteTree(fd, openvdb::gridPtrCast<Grid>(grid)->tree(), metadata, form, reporter);
  return true;
}

}  // namespace

void HandOverVdb(const std::filesystem::path& path, const VdbOptions& options, int fd,
                 Reporter* reporter) {
  reporter->Progress(0.0, "reading");
  CheckReadable(path);
  const openvdb::GridBase::Ptr grid = ReadChosenGrid(path, {options.grid, options.component});
  reporter->Progress(0.4, "converting");
  GridForm form;
  const auto type = std::find(std::begin(kGridTypes), std::end(kGridTypes), grid->valueType());
  if (type == std::end(kGridTypes)) {
    Refuse("a grid of type " + Quoted(grid->valueType()) +
           " has no scalar voxels; convert it first");
  }
  form.type = *type;
  VolumeMetadata metadata;
  metadata.source = options.source;
  metadata.original_type = OriginalType(form.type);
  metadata.is_level_set = grid->getGridClass() == openvdb::GRID_LEVEL_SET;
  const Box box = BoxOf(*grid);
  form.first = box.first;
  for (int k = 0; k < 3; ++k) {
    const std::int64_t voxels = box.size[static_cast<std::size_t>(k)];
    if (voxels > std::numeric_limits<int>::max() / 2) {
      throw Error(
          ErrorKind::kTooLarge,
          "its active voxels lie too far apart, over the limit; crop or resample the volume");
    }
    metadata.size[k] = static_cast<int>(voxels);
  }
  CopyOwnEntries(*grid, &metadata);
  CopyGeometry(grid->transform(), box.first, &metadata);
  if (options.spacing_mm) {
    metadata.spacing_mm = *options.spacing_mm;
  } else {
    if (!IsOwn(*grid)) {
      reporter->Warn("the file states no unit of length; its numbers are taken for mm, voxels of " +
                     ListOf(metadata.spacing_mm) +
                     " mm; --spacing-mm states others, 1000 times as large if it is in metres");
    }
    KeepMap(grid->transform(), &form);
  }
  KeepEntries(*grid, &form, reporter);
  reporter->Progress(0.6, "writing");
  Write<openvdb::FloatGrid>(grid, metadata, form, fd, reporter) ||
      Write<openvdb::DoubleGrid>(grid, metadata, form, fd, reporter) ||
      Write<openvdb::Int32Grid>(grid, metadata, form, fd, reporter) ||
      Write<openvdb::Int64Grid>(grid, metadata, form, fd, reporter) ||
      Write<openvdb::BoolGrid>(grid, metadata, form, fd, reporter);
}

}  // namespace palpate
