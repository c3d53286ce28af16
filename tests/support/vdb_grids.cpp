#include "tests/support/vdb_grids.h"

#include <openvdb/tools/LevelSetSphere.h>

#include <cmath>
#include <cstdint>
#include <cstring>
#include <functional>
#include <map>
#include <random>
#include <sstream>
#include <stdexcept>
#include <type_traits>

namespace palpate::testing {
namespace {

using openvdb::Coord;
using openvdb::CoordBBox;
using openvdb::math::Transform;

constexpr double kVoxelMm = 0.5;
constexpr int kLeafEdge = 8;

// The same numbers everywhere: the distributions of the standard library are not.
class Random {
 public:
  explicit Random(unsigned seed) : engine_(seed) {}
  std::int64_t Below(std::int64_t end) { return static_cast<std::int64_t>(engine_() % end); }
  // From 0 to 1.
  double Share() { return static_cast<double>(engine_() >> 11) / 9007199254740992.0; }

 private:
  std::mt19937_64 engine_;
};

void AddMetadata(openvdb::GridBase& grid) {
  grid.setCreator("a test");
  grid.insertMeta("note", openvdb::StringMetadata("Größe: 3 lines\nand \"quotes\""));
  grid.insertMeta("empty_note", openvdb::StringMetadata(""));
  grid.insertMeta("checked", openvdb::BoolMetadata(true));
  grid.insertMeta("frame", openvdb::Int32Metadata(-7));
  grid.insertMeta("time_ns", openvdb::Int64Metadata(std::int64_t{1} << 60));
  grid.insertMeta("dose", openvdb::FloatMetadata(0.1f));
  grid.insertMeta("angle", openvdb::DoubleMetadata(1.0 / 3.0));
  grid.insertMeta("wind", openvdb::Vec3SMetadata({0.1f, -2.0f, 3e30f}));
  grid.insertMeta("seat", openvdb::Vec3DMetadata({0.1, -2.0, 3e300}));
  grid.insertMeta("cells", openvdb::Vec3IMetadata({1, -2, 3}));
  openvdb::Mat4d matrix = openvdb::Mat4d::identity();
  matrix(1, 3) = 0.7;
  grid.insertMeta("camera", openvdb::Mat4DMetadata(matrix));
}

Transform::Ptr UniformElsewhere() {
  const auto transform = Transform::createLinearTransform(kVoxelMm);
  transform->postTranslate({1.2, -30.7, 4.1});
  return transform;
}

// Turned, with three different spacings; the axes stay at right angles.
Transform::Ptr Oblique() {
  openvdb::Mat4d matrix = openvdb::Mat4d::identity();
  matrix.postScale(openvdb::Vec3d(0.5, 0.75, 1.25));
  matrix.postRotate(openvdb::math::Z_AXIS, 0.5);
  matrix.postRotate(openvdb::math::X_AXIS, -0.3);
  matrix.postTranslate(openvdb::Vec3d(12.3, -45.6, 7.9));
  return Transform::createLinearTransform(matrix);
}

template <class Grid>
typename Grid::Ptr NewGrid(const std::string& name, typename Grid::ValueType background,
                           const Transform::Ptr& transform) {
  auto grid = Grid::create(background);
  grid->setName(name);
  grid->setTransform(transform);
  AddMetadata(*grid);
  return grid;
}

openvdb::Vec3d SphereCenter(int edge) { return {3.3, -5.7, 0.2 * edge + 11.1}; }  // voxels

openvdb::GridBase::Ptr Sphere(int edge, unsigned) {
  const openvdb::Vec3d center = kVoxelMm * SphereCenter(edge);
  const auto grid = openvdb::tools::createLevelSetSphere<openvdb::FloatGrid>(
      static_cast<float>(kVoxelMm * 0.45 * edge), openvdb::Vec3f(center),
      static_cast<float>(kVoxelMm));
  grid->setName("surface");
  AddMetadata(*grid);
  return grid;
}

// A random leaf: most voxels active, some inactive with values of their own.
void FillLeaf(openvdb::FloatTree& tree, const Coord& origin, bool active, Random& random) {
  auto* const leaf = tree.touchLeaf(origin);
  for (openvdb::Index n = 0; n < openvdb::FloatTree::LeafNodeType::SIZE; ++n) {
    const auto value = static_cast<float>(random.Share());
    const double kind = random.Share();
    if (active && kind < 0.6) {
      leaf->setValueOn(n, value);
    } else if (kind < 0.8) {
      leaf->setValueOff(n, value);
    }
  }
}

// What a tree may hold besides leaves in use.
void AddOddNodes(openvdb::FloatTree& tree, const CoordBBox& box, Random& random) {
  const Coord middle = box.min() + Coord(box.dim().x() / 2, box.dim().y() / 2, box.dim().z() / 2);
  tree.addTile(1, middle, 0.25f, true);
  tree.addTile(1, middle.offsetBy(0, 16, 0), 0.5f, true);
  tree.addTile(1, middle.offsetBy(0, 32, 0), 0.75f, false);
  tree.fill(CoordBBox::createCube(middle.offsetBy(16, 8, 8) & ~(kLeafEdge - 1), 16), 0.125f, true);
  const Coord end = box.max();
  tree.addTile(2, Coord(box.min().x(), end.y(), box.min().z()), 0.375f, true);
  tree.addTile(2, end.offsetBy(300, 0, 0), 0.625f, false);
  // Leaves without an active voxel, in the box and beyond it.
  for (const int away : {-24, 64, 700}) {
    FillLeaf(tree, end.offsetBy(0, away, away), /*active=*/false, random);
  }
  // Inner nodes without any child, of both levels.
  const Coord lower = end.offsetBy(-900, 40, 40), upper = end.offsetBy(9000, 40, 40);
  for (const Coord& origin : {lower, upper}) {
    tree.touchLeaf(origin);
    tree.addTile(1, origin, tree.background(), false);
  }
  tree.addTile(2, upper, tree.background(), false);
}

openvdb::GridBase::Ptr Cloud(int edge, unsigned seed) {
  const auto grid = NewGrid<openvdb::FloatGrid>("density", 0.0f, UniformElsewhere());
  grid->setGridClass(openvdb::GRID_FOG_VOLUME);
  Random random(seed);
  const Coord size(edge, edge / 2 + 300, edge);
  const Coord first(-19, -160, 45);
  const double leaves = 0.03 * size.x() * size.y() * size.z() / 512.0;
  for (int n = 0; n < leaves; ++n) {
    const Coord within(static_cast<int>(random.Below(size.x())),
                       static_cast<int>(random.Below(size.y())),
                       static_cast<int>(random.Below(size.z())));
    FillLeaf(grid->tree(), first + within, /*active=*/n % 50 != 0, random);
  }
  AddOddNodes(grid->tree(), {first, first + size.offsetBy(-1)}, random);
  return grid;
}

// value(place) in each voxel of a box, all active but one of 20, which keep the value.
template <class Grid, class Value>
void FillBox(Grid& grid, const Coord& first, const Coord& size, Random& random, Value value) {
  const CoordBBox box(first, first + size.offsetBy(-1));
  auto accessor = grid.getAccessor();
  for (auto at = box.begin(); at; ++at) {
    if (random.Below(20) == 0) {
      accessor.setValueOff(*at, value(*at));
    } else {
      accessor.setValueOn(*at, value(*at));
    }
  }
}

openvdb::GridBase::Ptr Negative(int edge, unsigned seed) {
  const auto grid = NewGrid<openvdb::FloatGrid>("scan", -1000.0f, Oblique());
  Random random(seed);
  FillBox(*grid, {-13, 5, -71}, {edge, edge / 2 + 3, edge - 5}, random, [&](const Coord& at) {
    const auto wave = std::sin(0.2 * at.x()) + std::cos(0.15 * at.y() + 0.1 * at.z());
    return static_cast<float>(300.0 * wave + 50.0 * random.Share());
  });
  return grid;
}

// Random values from `low` to `high`, an edge long and half as wide and high.
template <class Grid>
typename Grid::Ptr Scalars(int edge, unsigned seed, typename Grid::ValueType background, double low,
                           double high) {
  using Value = typename Grid::ValueType;
  const auto grid = NewGrid<Grid>("scalars", background, UniformElsewhere());
  Random random(seed);
  FillBox(*grid, {3, -9, 17}, {edge, edge / 2, edge / 2}, random, [&](const Coord&) {
    const double value = low + (high - low) * random.Share();
    return static_cast<Value>(std::is_integral_v<Value> ? std::floor(value + 0.5) : value);
  });
  return grid;
}

openvdb::GridBase::Ptr Half(int edge, unsigned seed) {
  const auto grid = Scalars<openvdb::FloatGrid>(edge, seed, 0.0f, 0.0, 4.0);
  grid->setSaveFloatAsHalf(true);
  return grid;
}

// Each region of 8³ voxels has a constant value of its own.
openvdb::GridBase::Ptr Tiles(int edge, unsigned) {
  const auto grid = NewGrid<openvdb::FloatGrid>("tiles", 0.0f, UniformElsewhere());
  float value = 0.0f;
  for (const CoordBBox box(Coord(0), Coord(edge - 1)); const Coord& at : box) {
    grid->tree().addTile(1, Coord(8 * at.x(), 8 * at.y(), 8 * at.z()), value += 1.0f, true);
  }
  return grid;
}

// Away from the middle of the sphere.
openvdb::GridBase::Ptr Vectors(int edge, unsigned seed) {
  const auto grid = NewGrid<openvdb::Vec3SGrid>("velocity", openvdb::Vec3f(0.0f),
                                                Transform::createLinearTransform(kVoxelMm));
  grid->setVectorType(openvdb::VEC_COVARIANT);
  Random random(seed);
  FillBox(*grid, {-11, -7, 3}, Coord(edge / 2), random, [&](const Coord& at) {
    return openvdb::Vec3f((at.asVec3d() - SphereCenter(edge)).unit());
  });
  return grid;
}

openvdb::GridBase::Ptr Frustum(int edge, unsigned seed) {
  const auto grid = Scalars<openvdb::FloatGrid>(edge, seed, 0.0f, 0.0, 1.0);
  const openvdb::BBoxd box(openvdb::Vec3d(0.0), openvdb::Vec3d(edge - 1.0));
  grid->setTransform(Transform::createFrustumTransform(box, 0.5, 10.0, 1.0));
  return grid;
}

template <class Value>
std::string Text(const CoordBBox& box, const Value& value, bool active) {
  std::ostringstream text;
  text.precision(17);
  text << value << (active ? " (active)" : " (inactive)") << " in " << box;
  return text.str();
}

// Bit by bit: -0 is not 0, and a NaN is itself.
template <class Value>
bool IsSame(const Value& a, const Value& b, bool rounded) {
  if (!rounded) return std::memcmp(&a, &b, sizeof(Value)) == 0;
  const auto x = static_cast<float>(a), y = static_cast<float>(b);
  return std::memcmp(&x, &y, sizeof(float)) == 0;
}

template <class Tree>
std::string TreeDifference(const Tree& a, const Tree& b, bool rounded) {
  if (!IsSame(a.background(), b.background(), rounded)) return "the backgrounds differ";
  if (!a.hasSameTopology(b)) return "the topologies differ";
  if (a.leafCount() != b.leafCount()) return "the numbers of leaves differ";
  if (a.nonLeafCount() != b.nonLeafCount()) return "the numbers of inner nodes differ";
  auto at_a = a.cbeginValueAll();
  auto at_b = b.cbeginValueAll();
  for (; at_a && at_b; ++at_a, ++at_b) {
    CoordBBox box_a, box_b;
    at_a.getBoundingBox(box_a);
    at_b.getBoundingBox(box_b);
    if (at_a.getLevel() != at_b.getLevel() || box_a != box_b ||
        at_a.isValueOn() != at_b.isValueOn() ||
        !IsSame(at_a.getValue(), at_b.getValue(), rounded)) {
      return Text(box_b, at_b.getValue(), at_b.isValueOn()) + ", not " +
             Text(box_a, at_a.getValue(), at_a.isValueOn());
    }
  }
  return bool(at_a) == bool(at_b) ? "" : "one tree has more values";
}

std::string MetadataDifference(const openvdb::MetaMap& a, const openvdb::MetaMap& b) {
  const auto is_of_file = [](const std::string& name) { return name.starts_with("file_"); };
  for (auto entry = a.beginMeta(); entry != a.endMeta(); ++entry) {
    const auto& [name, value] = *entry;
    if (is_of_file(name)) continue;  // OpenVDB writes it anew.
    const auto other = b[name];
    if (!other) return "the metadata " + name + " is missing";
    if (*value != *other) return "the metadata " + name + " is " + other->str();
  }
  for (auto entry = b.beginMeta(); entry != b.endMeta(); ++entry) {
    const std::string& name = entry->first;
    if (!a[name] && !is_of_file(name) && !name.starts_with("palpate_")) {
      return "the metadata " + name + " is new";
    }
  }
  return "";
}

// Not ==, which tolerates a little.
bool IsSame(const Transform& a, const Transform& b) {
  const auto bytes = [](const Transform& transform) {
    std::ostringstream out(std::ios::binary);
    transform.write(out);
    return out.str();
  };
  return a.mapType() == b.mapType() && bytes(a) == bytes(b);
}

}  // namespace

openvdb::GridBase::Ptr MakeVdbGrid(const std::string& kind, int edge, unsigned seed) {
  using openvdb::Int32Grid;
  openvdb::initialize();
  static const std::map<std::string, std::function<openvdb::GridBase::Ptr(int, unsigned)>> makers =
      {
          {"sphere", Sphere},
          {"cloud", Cloud},
          {"negative", Negative},
          {"uint8", [](int e, unsigned s) { return Scalars<Int32Grid>(e, s, 0, 0.0, 255.0); }},
          {"int16", [](int e, unsigned s) { return Scalars<Int32Grid>(e, s, -1024, -1024, 3071); }},
          {"int32", [](int e, unsigned s) { return Scalars<Int32Grid>(e, s, 0, -5.0, 2e9); }},
          {"double",
           [](int e, unsigned s) { return Scalars<openvdb::DoubleGrid>(e, s, 0.0, -1.0, 1.0); }},
          {"half", Half},
          {"tiles", Tiles},
          {"bool",
           [](int e, unsigned s) { return Scalars<openvdb::BoolGrid>(e, s, false, 0.0, 1.0); }},
          {"vector", Vectors},
          {"frustum", Frustum},
      };
  return makers.at(kind)(edge, seed);
}

void WriteVdb(const std::filesystem::path& path, const openvdb::GridCPtrVec& grids) {
  openvdb::initialize();
  openvdb::io::File file(path.string());
  file.setCompression(openvdb::io::COMPRESS_BLOSC | openvdb::io::COMPRESS_ACTIVE_MASK);
  file.write(grids);
  file.close();
}

openvdb::GridBase::Ptr ReadVdb(const std::filesystem::path& path) {
  openvdb::initialize();
  openvdb::io::File file(path.string());
  file.open(/*delayLoad=*/false);
  const openvdb::GridPtrVecPtr grids = file.getGrids();
  if (grids->size() != 1) throw std::runtime_error(path.string() + " does not hold one grid");
  return grids->front();
}

std::string VdbDifference(const openvdb::GridBase& expected, const openvdb::GridBase& is,
                          bool rounded) {
  if (expected.type() != is.type()) return "the type is " + is.type();
  if (expected.getGridClass() != is.getGridClass()) return "the classes differ";
  if (!IsSame(expected.transform(), is.transform())) return "the transforms differ";
  std::string first = MetadataDifference(expected, is);
  if (!first.empty()) return first;
  using Types = openvdb::TypeList<openvdb::FloatGrid, openvdb::DoubleGrid, openvdb::Int32Grid,
                                  openvdb::Int64Grid, openvdb::BoolGrid>;
  const bool known = expected.apply<Types>([&](const auto& typed) {
    using Grid = std::decay_t<decltype(typed)>;
    first = TreeDifference(typed.tree(), static_cast<const Grid&>(is).tree(), rounded);
  });
  if (!known) throw std::runtime_error("grids of " + expected.type() + " are not compared");
  return first;
}

}  // namespace palpate::testing
