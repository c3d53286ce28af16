#include "server/import/vdb_grids.h"

#include <openvdb/io/Stream.h>

#include <algorithm>
#include <fstream>
#include <memory>
#include <string_view>
#include <vector>

#include "server/import/image_header.h"
#include "server/volume/snapshot/openvdb_grids.h"

namespace palpate {
namespace {

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

}  // namespace

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

}  // namespace palpate
