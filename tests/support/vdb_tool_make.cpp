#include <openvdb/points/PointConversion.h>
#include <openvdb/tools/LevelSetSphere.h>

#include <cmath>
#include <cstdint>
#include <functional>
#include <map>
#include <random>

#include "server/volume/openvdb_grids.h"
#include "tests/support/vdb_tool.h"

namespace palpate::vdb_tool {
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
  grid.setCreator("vdb_tool");
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

Transform::Ptr Uniform() { return Transform::createLinearTransform(kVoxelMm); }

Transform::Ptr UniformElsewhere() {
  const auto transform = Uniform();
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

// The centre of the sphere, voxels: parts of it have negative indices.
openvdb::Vec3d SphereCenter(int edge) { return {3.3, -5.7, 0.2 * edge + 11.1}; }
double SphereRadius(int edge) { return 0.45 * edge; }

openvdb::FloatGrid::Ptr Sphere(const MakeOptions& options) {
  const openvdb::Vec3d center = kVoxelMm * SphereCenter(options.edge);
  const auto grid = openvdb::tools::createLevelSetSphere<openvdb::FloatGrid>(
      static_cast<float>(kVoxelMm * SphereRadius(options.edge)), openvdb::Vec3f(center),
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

openvdb::FloatGrid::Ptr Cloud(const MakeOptions& options, double share) {
  const auto grid = NewGrid<openvdb::FloatGrid>("density", 0.0f, UniformElsewhere());
  grid->setGridClass(openvdb::GRID_FOG_VOLUME);
  Random random(options.seed);
  const Coord size(options.edge, options.edge / 2 + 300, options.edge);
  const Coord first(-19, -160, 45);
  const double leaves = share * size.x() * size.y() * size.z() / 512.0;
  for (int n = 0; n < leaves; ++n) {
    const Coord within(static_cast<int>(random.Below(size.x())),
                       static_cast<int>(random.Below(size.y())),
                       static_cast<int>(random.Below(size.z())));
    FillLeaf(grid->tree(), first + within, /*active=*/n % 50 != 0, random);
  }
  AddOddNodes(grid->tree(), {first, first + size.offsetBy(-1)}, random);
  return grid;
}

// value() in each voxel of a box, all active but some, which keep the value.
template <class Grid>
void FillBox(Grid& grid, const Coord& first, const Coord& size, Random& random,
             const std::function<typename Grid::ValueType(const Coord&)>& value) {
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

openvdb::FloatGrid::Ptr Negative(const MakeOptions& options) {
  const auto grid = NewGrid<openvdb::FloatGrid>("scan", -1000.0f, Oblique());
  Random random(options.seed);
  const int n = options.edge;
  // All of it active, so that the box begins there.
  const CoordBBox box({-13, 5, -71}, Coord(-13, 5, -71) + Coord(n, n / 2 + 3, n - 5).offsetBy(-1));
  auto accessor = grid->getAccessor();
  for (auto at = box.begin(); at; ++at) {
    const auto wave = std::sin(0.2 * (*at).x()) + std::cos(0.15 * (*at).y() + 0.1 * (*at).z());
    accessor.setValueOn(*at, static_cast<float>(300.0 * wave + 50.0 * random.Share()));
  }
  return grid;
}

// A scalar grid of random values from `low` to `high`, an edge long and half as wide and high.
template <class Grid>
typename Grid::Ptr Scalars(const std::string& name, const MakeOptions& options,
                           typename Grid::ValueType background, double low, double high) {
  using Value = typename Grid::ValueType;
  const auto grid = NewGrid<Grid>(name, background, UniformElsewhere());
  Random random(options.seed);
  FillBox<Grid>(*grid, {3, -9, 17}, {options.edge, options.edge / 2, options.edge / 2}, random,
                [&](const Coord&) {
                  const double value = low + (high - low) * random.Share();
                  if constexpr (std::is_integral_v<Value>) {
                    return static_cast<Value>(std::floor(value + 0.5));
                  } else {
                    return static_cast<Value>(value);
                  }
                });
  return grid;
}

openvdb::FloatGrid::Ptr Half(const MakeOptions& options) {
  const auto grid = Scalars<openvdb::FloatGrid>("half", options, 0.0f, 0.0, 4.0);
  grid->setSaveFloatAsHalf(true);
  return grid;
}

// Unit vectors away from the middle of the sphere.
openvdb::Vec3SGrid::Ptr Velocity(const MakeOptions& options) {
  const auto grid = NewGrid<openvdb::Vec3SGrid>("velocity", openvdb::Vec3f(0.0f), Uniform());
  grid->setVectorType(openvdb::VEC_COVARIANT);
  Random random(options.seed);
  const openvdb::Vec3d center = SphereCenter(options.edge);
  FillBox<openvdb::Vec3SGrid>(*grid, {-11, -7, 3}, Coord(options.edge / 2), random,
                              [&](const Coord& at) {
                                openvdb::Vec3d away = at.asVec3d() - center;
                                away.normalize();
                                return openvdb::Vec3f(away);
                              });
  return grid;
}

openvdb::GridBase::Ptr Points(const MakeOptions& options) {
  Random random(options.seed);
  std::vector<openvdb::Vec3f> positions(1000);
  for (openvdb::Vec3f& position : positions) {
    for (int axis = 0; axis < 3; ++axis) {
      position[axis] = static_cast<float>(random.Share() * kVoxelMm * options.edge);
    }
  }
  const auto grid =
      openvdb::points::createPointDataGrid<openvdb::points::NullCodec,
                                           openvdb::points::PointDataGrid>(positions, *Uniform());
  grid->setName("points");
  AddMetadata(*grid);
  return grid;
}

openvdb::FloatGrid::Ptr Frustum(const MakeOptions& options) {
  const auto grid = Scalars<openvdb::FloatGrid>("frustum", options, 0.0f, 0.0, 1.0);
  const openvdb::BBoxd box(openvdb::Vec3d(0.0), openvdb::Vec3d(options.edge - 1.0));
  grid->setTransform(Transform::createFrustumTransform(box, 0.5, 10.0, 1.0));
  return grid;
}

using Maker = std::function<openvdb::GridPtrVec(const MakeOptions&)>;

const std::map<std::string, Maker>& Makers() {
  using Options = const MakeOptions&;
  static const std::map<std::string, Maker> makers = {
      {"sphere", [](Options o) -> openvdb::GridPtrVec { return {Sphere(o)}; }},
      {"cloud", [](Options o) -> openvdb::GridPtrVec { return {Cloud(o, 0.03)}; }},
      {"dense-cloud", [](Options o) -> openvdb::GridPtrVec { return {Cloud(o, 0.4)}; }},
      {"negative", [](Options o) -> openvdb::GridPtrVec { return {Negative(o)}; }},
      {"uint8",
       [](Options o) -> openvdb::GridPtrVec {
         return {Scalars<openvdb::Int32Grid>("uint8", o, 0, 0.0, 255.0)};
       }},
      {"int16",
       [](Options o) -> openvdb::GridPtrVec {
         return {Scalars<openvdb::Int32Grid>("int16", o, -1024, -1024.0, 3071.0)};
       }},
      {"int32-large",
       [](Options o) -> openvdb::GridPtrVec {
         return {Scalars<openvdb::Int32Grid>("int32", o, 0, -5.0, 2e9)};
       }},
      {"double",
       [](Options o) -> openvdb::GridPtrVec {
         return {Scalars<openvdb::DoubleGrid>("double", o, 0.0, -1.0, 1.0)};
       }},
      {"half", [](Options o) -> openvdb::GridPtrVec { return {Half(o)}; }},
      {"bool",
       [](Options o) -> openvdb::GridPtrVec {
         return {Scalars<openvdb::BoolGrid>("bool", o, false, 0.0, 1.0)};
       }},
      {"vector", [](Options o) -> openvdb::GridPtrVec { return {Velocity(o)}; }},
      {"two",
       [](Options o) -> openvdb::GridPtrVec {
         return {Cloud(o, 0.03), Sphere(o), Velocity(o)};
       }},
      {"same-names",
       [](Options o) -> openvdb::GridPtrVec {
         return {Cloud(o, 0.03), Cloud(o, 0.01)};
       }},
      {"empty",
       [](Options) -> openvdb::GridPtrVec {
         return {NewGrid<openvdb::FloatGrid>("density", 0.0f, Uniform())};
       }},
      {"points", [](Options o) -> openvdb::GridPtrVec { return {Points(o)}; }},
      {"frustum", [](Options o) -> openvdb::GridPtrVec { return {Frustum(o)}; }},
  };
  return makers;
}

}  // namespace

openvdb::GridPtrVec MakeGrids(const std::string& kind, const MakeOptions& options) {
  const auto maker = Makers().find(kind);
  if (maker == Makers().end()) {
    throw Failure("there is no kind " + kind + "; the kinds are " + KindNames());
  }
  return maker->second(options);
}

std::string KindNames() {
  std::string names;
  for (const auto& [name, maker] : Makers()) names += (names.empty() ? "" : ", ") + name;
  return names;
}

}  // namespace palpate::vdb_tool
