// The files that clients write of a copy of the volume: other programs and palpated read the same.
#include <gtest/gtest.h>
#include <signal.h>
#include <sys/resource.h>

#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <cstdint>
#include <cstring>
#include <filesystem>
#include <functional>
#include <iterator>
#include <limits>
#include <memory>
#include <optional>
#include <random>
#include <string>
#include <vector>

#include "client/files/download_file.h"
#include "client/sdk/nrrd_file.h"
#include "common/bricks/brick_map.h"
#include "common/bricks/volume_event.h"
#include "server/volume/load/import_process.h"
#include "server/volume/save/volume_file.h"
#include "tests/support/made_volume.h"
#include "tests/support/places.h"
#include "tests/support/refusal.h"
#include "tests/support/temporary_folder.h"
#include "tests/support/vdb_grids.h"
#include "tests/support/voxels.h"

namespace palpate::client {
namespace {

// Volumes as clients hold them: bricks of chosen types, tiles and background in an oblique frame.

struct TypedVolume {
  VolumeLattice lattice;
  BrickMap bricks{};
};

inline VolumeLattice ObliqueLattice(const Vec3i& size, bool is_mirrored = false) {
  VolumeLattice lattice;
  lattice.source = "scan.nrrd";
  lattice.size = size;
  lattice.spacing_mm = Vec3(0.4882812, 0.7, 1.25);
  lattice.value_min = -30000.0;
  lattice.value_max = 60000.0;
  lattice.unit = "HU";
  Mat3 axes = Eigen::AngleAxisd(0.9, Vec3(1, -2, 3).normalized()).toRotationMatrix();
  if (is_mirrored) axes.col(1) *= -1;
  lattice.X_WI = {axes * lattice.spacing_mm.asDiagonal(), Vec3(-123.25, 77.1, 1e3 / 3)};
  return lattice;
}

// Numbers of the whole range of T; of floats also -0.
template <class T>
TypedBrickPtr NoiseBrick(std::mt19937& random) {
  std::array<T, kBrickVoxels> values;
  for (T& value : values) {
    if constexpr (std::is_same_v<T, float>) {
      value = std::uniform_real_distribution<float>(-30000, 60000)(random);
      if (random() % 16 == 0) value = -0.0f;
    } else {
      value = static_cast<T>(random());
    }
  }
  return TypedBrick::Of<T>(values);
}

// Bricks of these types by turns; every third is background, every fifth has another value.
// Beyond the lattice there is noise, too.
inline TypedVolume NoiseVolume(const Vec3i& size, const std::vector<LeafType>& types,
                               float background, unsigned seed = 1) {
  TypedVolume volume{ObliqueLattice(size, seed % 2 == 1)};
  volume.lattice.value_min = background;
  volume.lattice.type = types.front();
  volume.bricks =
      BrickMap(volume.lattice.BrickCounts(), TypedBrick::Constant(volume.lattice.type, background));
  std::mt19937 random(seed);
  for (std::uint64_t number = 0; number < volume.bricks.size(); ++number) {
    const LeafType type = types[number % types.size()];
    if (number % 3 == 2) continue;
    volume.bricks.Put(number, number % 5 == 4 ? TypedBrick::Constant(type, 7.0f)
                                              : VisitType(type, [&](auto voxel) {
                                                  return NoiseBrick<decltype(voxel)>(random);
                                                }));
  }
  return volume;
}

namespace fs = std::filesystem;
using testing::Refusal;
using enum LeafType;

std::uint32_t Bits(float value) { return std::bit_cast<std::uint32_t>(value); }

class DownloadedFiles : public ::testing::Test {
 protected:
  fs::path Path(const std::string& name) const { return folder_.path() / name; }

  void SaveVdb(const TypedVolume& volume, const VdbOrigin& origin = {}) const {
    SaveAsVdb(volume.bricks, volume.lattice, origin, Path("a.vdb"), true);
  }
  void SaveNrrd(const TypedVolume& volume) const {
    SaveAsNrrd(volume.bricks, volume.lattice, true, Path("a.nrrd"), true);
  }
  // As palpated loads it.
  LoadedVolume Loaded(const std::string& name) const {
    ImportRequest request;
    request.source = Path(name);
    request.import_program = test::kPalpateImport;
    return ImportVolume(request, {}, {});
  }

  test::TemporaryFolder folder_;
};

void ExpectSame(const TypedVolume& volume, const LoadedVolume& loaded) {
  const VolumeLattice& lattice = volume.lattice;
  const VolumeMetadata& metadata = loaded.metadata;
  ASSERT_EQ(metadata.size, lattice.size);
  testing::ForEachVoxel(lattice.size, [&](const Vec3i& p) {
    ASSERT_EQ(Bits(testing::ValueAt(loaded.bricks, p)),
              Bits(volume.bricks.Value(p.x(), p.y(), p.z())))
        << p.transpose();
  });
  EXPECT_EQ(metadata.unit, lattice.unit);
  EXPECT_TRUE(metadata.WorldFromIndex().linear.isApprox(lattice.X_WI.linear, 1e-12));
  EXPECT_TRUE(metadata.origin_W_mm.isApprox(lattice.X_WI.translation, 1e-12));
}

const Vec3i kSizes[] = {{2, 2, 2}, {8, 64, 9}, {130, 20, 75}, {33, 40, 17}};

// A volume's types, and the smallest type that holds all of its voxels.
struct Mixture {
  std::vector<LeafType> types;
  LeafType smallest;
  float background;
};
const Mixture kMixtures[] = {
    {{kUint8}, kUint8, 3},          {{kInt16}, kInt16, -1024},     {{kUint16}, kUint16, 40000},
    {{kFloat}, kFloat, 0.25f},      {{kInt16, kUint8}, kInt16, 0}, {{kUint8, kUint16}, kUint16, 0},
    {{kInt16, kUint16}, kFloat, 0}, {{kUint8, kFloat}, kFloat, 0},
};

// --- NRRD

// The lines of the header as they are, and the bytes that follow.
struct Nrrd {
  std::string header, voxels;
  explicit Nrrd(const fs::path& path) {
    const std::string text = test::TextOf(path);
    const std::size_t end = text.find("\n\n") + 2;
    header = text.substr(0, end);
    voxels = text.substr(end);
  }
};

TEST_F(DownloadedFiles, AnNrrdFileHoldsAllVoxelsInTheSmallestType) {
  unsigned seed = 0;
  for (const auto& [types, smallest, background] : kMixtures) {
    for (const Vec3i& size : kSizes) {
      const TypedVolume volume = NoiseVolume(size, types, background, ++seed);
      // The bricks of a small volume may do with a smaller type.
      const LeafType type = volume.bricks.SmallestType();
      if (volume.bricks.size() > 8) {
        ASSERT_EQ(type, smallest);
      }
      SaveNrrd(volume);
      const Nrrd file(Path("a.nrrd"));
      const std::string name = type == kFloat ? "float" : std::string(Name(type));
      EXPECT_NE(file.header.find("\ntype: " + name + "\n"), std::string::npos) << file.header;
      EXPECT_NE(file.header.find("\nsample units: \"HU\"\n"), std::string::npos);
      ASSERT_EQ(file.voxels.size(), size.prod() * VoxelBytes(type));
      VisitType(type, [&](auto voxel) {
        for (int n = 0; n < size.prod(); ++n) {
          std::memcpy(&voxel, file.voxels.data() + n * sizeof voxel, sizeof voxel);
          const int i = n % size.x(), j = n / size.x() % size.y(), k = n / size.x() / size.y();
          ASSERT_EQ(Bits(static_cast<float>(voxel)), Bits(volume.bricks.Value(i, j, k)));
        }
      });
    }
    ExpectSame(NoiseVolume(kSizes[3], types, background, seed), Loaded("a.nrrd"));
  }
}

TEST_F(DownloadedFiles, AnNrrdFileBeyondReasonIsRefused) {
  const auto refusal = [](int x, int y, int z, LeafType type) {
    return Refusal([&] { CheckNrrdSize({x, y, z}, type); });
  };
  EXPECT_EQ(refusal(2048, 2048, 1024, kFloat), std::nullopt);
  EXPECT_EQ(refusal(2048, 2048, 2048, kUint16), std::nullopt);
  EXPECT_EQ(refusal(2048, 2048, 4096, kUint8), std::nullopt);
  EXPECT_EQ(refusal(2048, 2048, 1025, kFloat), ErrorKind::kTooLarge);
  EXPECT_EQ(refusal(2048, 2048, 2049, kInt16), ErrorKind::kTooLarge);
  EXPECT_EQ(refusal(1 << 30, 1 << 30, 1 << 30, kUint8), ErrorKind::kTooLarge);

  VolumeLattice lattice = ObliqueLattice({2048, 2048, 1025});
  BrickMap bricks(lattice.BrickCounts(), TypedBrick::Constant(kUint8, 0));
  bricks.Put(17, TypedBrick::Constant(kFloat, 0.5f));
  const auto save = [&] { SaveAsNrrd(bricks, lattice, true, Path("a.nrrd")); };
  EXPECT_EQ(Refusal(save), ErrorKind::kTooLarge);
  EXPECT_NE(testing::Complaint(save).find(".vdb"), std::string::npos);
  EXPECT_TRUE(fs::is_empty(folder_.path()));
}

// --- OpenVDB

// Calls visit(grid), whichever of the two types it is.
void VisitGrid(const openvdb::GridBase& grid, const auto& visit) {
  using Types = openvdb::TypeList<openvdb::FloatGrid, openvdb::Int32Grid>;
  ASSERT_TRUE(grid.apply<Types>(visit)) << grid.type();
}

openvdb::Coord ToCoord(const Vec3i& p) { return {p.x(), p.y(), p.z()}; }

TEST_F(DownloadedFiles, AVdbFileHoldsTheVoxelsWhereTheyAre) {
  unsigned seed = 0;
  for (const Mixture& mixture : kMixtures) {
    const float background = mixture.background;
    for (const Vec3i& size : kSizes) {
      const TypedVolume volume = NoiseVolume(size, mixture.types, background, ++seed);
      SaveVdb(volume);
      const auto grid = testing::ReadVdb(Path("a.vdb"));
      EXPECT_EQ(grid->isType<openvdb::FloatGrid>(), volume.bricks.SmallestType() == kFloat);
      EXPECT_EQ(grid->getName(), "density");
      EXPECT_EQ(grid->getGridClass(), openvdb::GRID_UNKNOWN);
      std::uint64_t active = 0;
      VisitGrid(*grid, [&](const auto& typed) {
        EXPECT_EQ(Bits(static_cast<float>(typed.background())), Bits(background));
        testing::ForEachVoxel(size, [&](const Vec3i& p) {
          const float value = volume.bricks.Value(p.x(), p.y(), p.z());
          ASSERT_EQ(Bits(static_cast<float>(typed.tree().getValue(ToCoord(p)))), Bits(value));
          ASSERT_EQ(typed.tree().isValueOn(ToCoord(p)), Bits(value) != Bits(background));
          active += Bits(value) != Bits(background);
        });
      });
      EXPECT_EQ(grid->activeVoxelCount(), active) << "some lie beyond the lattice";
      for (const Vec3i& p : {Vec3i(0, 0, 0), Vec3i(3, 40, 5), Vec3i(-7, 1, 99)}) {
        const Vec3 expected = volume.lattice.X_WI.Apply(p.cast<double>());
        const openvdb::Vec3d p_W = grid->indexToWorld(ToCoord(p));
        for (int k = 0; k < 3; ++k) EXPECT_NEAR(p_W[k], expected[k], 1e-10);
      }
    }
    ExpectSame(NoiseVolume(kSizes[3], mixture.types, background, seed), Loaded("a.vdb"));
  }
}

// The daemon's own bricks.
LeafPtr LeafOf(const TypedBrick& brick) {
  return brick.is_constant() ? Leaf::Constant(brick.type(), brick[0])
                             : Leaf::Of(brick.type(), brick.Floats());
}

TEST_F(DownloadedFiles, AVdbFileIsThatOfPalpated) {
  unsigned seed = 0;
  for (const auto& [types, smallest, background] : kMixtures) {
    TypedVolume volume = NoiseVolume({33, 40, 17}, types, background, ++seed);
    // palpated has an inactive -0 in front of 0, and OpenVDB loses it.
    if (smallest == kFloat && background == 0) volume.lattice.value_min = 0.25;
    SaveVdb(volume, {.original_type = smallest == kFloat ? "float64" : "int32", .frames = 5});

    VolumeMetadata metadata;
    metadata.size = volume.lattice.size;
    metadata.spacing_mm = volume.lattice.spacing_mm;
    metadata.origin_W_mm = volume.lattice.X_WI.translation;
    metadata.direction =
        volume.lattice.X_WI.linear * volume.lattice.spacing_mm.cwiseInverse().asDiagonal();
    metadata.value_min = volume.lattice.Background();
    metadata.value_max = volume.lattice.value_max;
    metadata.frames = 5;
    metadata.unit = volume.lattice.unit;
    metadata.original_type = smallest == kFloat ? "float64" : "int32";
    metadata.source = volume.lattice.source;
    const BrickDirectory bricks(
        metadata.size, [&](const Vec3i& place) { return LeafOf(*volume.bricks.At(place)); });
    WriteVolumeFile(Path("palpated.vdb"), bricks, metadata);
    const auto expected = testing::ReadVdb(Path("palpated.vdb"));
    const auto is = testing::ReadVdb(Path("a.vdb"));
    // Of the transforms, rounding.
    for (int k = 0; k < 3; ++k) {
      EXPECT_NEAR(is->voxelSize()[k], expected->voxelSize()[k], 1e-12);
    }
    is->setTransform(expected->transformPtr());
    EXPECT_EQ(testing::VdbDifference(*is, *expected), "");
  }
}

constexpr float kBand = 1.5f;

// A ball of signed distances around the middle: within `band` only, as OpenVDB holds it.
TypedVolume Ball(const Vec3i& size, double radius) {
  TypedVolume volume{ObliqueLattice(size)};
  volume.lattice.value_min = -kBand;
  volume.lattice.value_max = kBand;
  volume.lattice.background = kBand;
  const Vec3i count = volume.lattice.BrickCounts();
  const TypedBrickPtr outside = TypedBrick::Constant(kFloat, kBand);
  const TypedBrickPtr inside = TypedBrick::Constant(kFloat, -kBand);
  volume.bricks = BrickMap(count, outside);
  const Vec3 center = size.cast<double>() / 2;
  for (std::uint64_t number = 0; number < volume.bricks.size(); ++number) {
    const Vec3i first = BrickWithNumber(number, count) * kBrickEdge;
    const double middle = ((first.cast<double>().array() + 3.5).matrix() - center).norm() - radius;
    if (middle > 10) continue;
    if (middle < -10) {
      volume.bricks.Put(number, inside);
      continue;
    }
    Brick values;
    for (int n = 0; n < kBrickVoxels; ++n) {
      const Vec3i p = first + Vec3i(n >> 6, n >> 3 & 7, n & 7);
      const double distance = (p.cast<double>() - center).norm() - radius;
      values[n] = std::clamp(static_cast<float>(distance), -kBand, kBand);
    }
    volume.bricks.Put(number, TypedBrick::Of<float>(values));
  }
  return volume;
}

TEST_F(DownloadedFiles, ALevelSetIsItsBand) {
  const TypedVolume ball = Ball({77, 64, 90}, 25.0);
  SaveVdb(ball);
  const auto grid = openvdb::gridPtrCast<openvdb::FloatGrid>(testing::ReadVdb(Path("a.vdb")));
  ASSERT_NE(grid, nullptr);
  EXPECT_EQ(grid->getGridClass(), openvdb::GRID_LEVEL_SET);
  EXPECT_EQ(grid->background(), kBand);
  testing::ForEachVoxel(ball.lattice.size, [&](const Vec3i& p) {
    const float value = ball.bricks.Value(p.x(), p.y(), p.z());
    ASSERT_EQ(grid->tree().getValue(ToCoord(p)), value);
    ASSERT_EQ(grid->tree().isValueOn(ToCoord(p)), std::abs(value) < kBand);
  });
  const LoadedVolume loaded = Loaded("a.vdb");
  ExpectSame(ball, loaded);
  EXPECT_TRUE(loaded.metadata.is_level_set);
  EXPECT_EQ(loaded.metadata.value_min, -kBand);
  EXPECT_EQ(loaded.metadata.value_max, kBand);
}

TEST_F(DownloadedFiles, AVdbFileOfASparseVolumeTakesItsBricks) {
  TypedVolume volume{ObliqueLattice({4096, 4096, 4093})};
  VolumeLattice& lattice = volume.lattice;
  lattice.value_min = 0;
  lattice.type = kInt16;
  const Vec3i count = lattice.BrickCounts();
  volume.bricks = BrickMap(count, TypedBrick::Constant(kInt16, 0));
  std::mt19937 random(3);
  const Vec3i places[] = {{0, 0, 0}, {200, 300, 400}, {511, 511, 511}};
  for (const Vec3i& place : places) {
    volume.bricks.Put(BrickNumber(place, count), NoiseBrick<std::int16_t>(random));
  }
  // A node of 128³ voxels, and one less a brick.
  const TypedBrickPtr seven = TypedBrick::Constant(kInt16, 7);
  for (int a = 0; a < 16; ++a) {
    for (int b = 0; b < 16; ++b) {
      volume.bricks.Fill({BrickNumber({64 + a, 64 + b, 64}, count), a + b == 30 ? 31u : 32u},
                         seven);
    }
  }
  SaveVdb(volume);
  EXPECT_LT(fs::file_size(Path("a.vdb")), 64u << 10);
  const auto grid = openvdb::gridPtrCast<openvdb::Int32Grid>(testing::ReadVdb(Path("a.vdb")));
  ASSERT_NE(grid, nullptr);
  EXPECT_EQ(grid->tree().leafCount(), 3u);
  EXPECT_EQ(grid->tree().getValueDepth({512, 512, 512}), 1) << "not one tile of 128³ voxels";
  EXPECT_EQ(grid->tree().getValueDepth({512, 512, 640}), 2);
  EXPECT_EQ(grid->tree().getValue({639, 639, 760}), 0);
  for (const Vec3i& place : places) {
    for (int n = 0; n < kBrickVoxels; ++n) {
      const Vec3i p = place * kBrickEdge + Vec3i(n >> 6, n >> 3 & 7, n & 7);
      const bool is_there = (p.array() < lattice.size.array()).all();
      ASSERT_EQ(grid->tree().getValue(ToCoord(p)),
                is_there ? volume.bricks.Value(p.x(), p.y(), p.z()) : 0);
    }
  }
}

TEST_F(DownloadedFiles, AVdbFileTellsOfTheOriginal) {
  const TypedVolume volume = NoiseVolume({9, 9, 9}, {kUint16}, 0);
  SaveVdb(volume);
  EXPECT_EQ(Loaded("a.vdb").metadata.original_type, "uint16");
  EXPECT_EQ(Loaded("a.vdb").metadata.frames, 1);
  SaveVdb(volume, {.original_type = "float64", .frames = 20});
  EXPECT_EQ(Loaded("a.vdb").metadata.original_type, "float64");
  EXPECT_EQ(Loaded("a.vdb").metadata.frames, 20);
}

// --- Both

using Save = std::function<void(const TypedVolume&, const std::string& path, bool overwrite,
                                const std::function<void()>& check)>;
struct NamedSave {
  const char* name;
  Save save;
};
const NamedSave kSaves[] = {
    {"a.nrrd",
     [](const TypedVolume& volume, const std::string& path, bool overwrite, const auto& check) {
       SaveAsNrrd(volume.bricks, volume.lattice, true, path, overwrite, check);
     }},
    {"a.vdb",
     [](const TypedVolume& volume, const std::string& path, bool overwrite, const auto& check) {
       SaveAsVdb(volume.bricks, volume.lattice, {}, path, overwrite, check);
     }},
};

TEST_F(DownloadedFiles, AFileIsReplacedOnlyIfItMayBe) {
  const TypedVolume a = NoiseVolume({20, 9, 9}, {kFloat}, 0, 1);
  const TypedVolume b = NoiseVolume({20, 9, 9}, {kFloat}, 0, 2);
  for (const NamedSave& to : kSaves) {
    to.save(a, Path(to.name), false, {});
    EXPECT_EQ(Refusal([&] { to.save(b, Path(to.name), false, {}); }), ErrorKind::kConflict);
    ExpectSame(a, Loaded(to.name));
    to.save(b, Path(to.name), true, {});
    ExpectSame(b, Loaded(to.name));
    EXPECT_EQ(Refusal([&] { to.save(a, folder_.path(), true, {}); }), ErrorKind::kInvalidArgument);
    EXPECT_EQ(Refusal([&] { to.save(a, Path("none") / to.name, true, {}); }), ErrorKind::kNotFound);
  }
}

TEST_F(DownloadedFiles, CancelledAtAnyTimeLeavesTheOldFileAndNothingElse) {
  const TypedVolume a = NoiseVolume({20, 9, 9}, {kFloat}, 0, 1);
  const TypedVolume b = NoiseVolume({140, 90, 140}, {kFloat}, 0, 2);
  for (const NamedSave& to : kSaves) {
    to.save(a, Path(to.name), true, {});
    const std::string before = test::TextOf(Path(to.name));
    int questions = 0;
    to.save(b, Path("b"), true, [&] { ++questions; });
    fs::remove(Path("b"));
    ASSERT_GE(questions, 3) << to.name;
    for (int at = 1; at <= questions; at += 1 + questions / 5) {
      int asked = 0;
      const auto check = [&] {
        if (++asked == at) throw Error(ErrorKind::kCancelled, "cancelled");
      };
      EXPECT_EQ(Refusal([&] { to.save(b, Path(to.name), true, check); }), ErrorKind::kCancelled);
      EXPECT_EQ(test::TextOf(Path(to.name)), before);
      EXPECT_EQ(std::distance(fs::directory_iterator(folder_.path()), {}), 1);
    }
    fs::remove(Path(to.name));
  }
}

// Files may grow to a limit here, as on a disk that fills up.
TEST_F(DownloadedFiles, AFullDiskIsSaidAndLeavesTheOldFile) {
  const TypedVolume a = NoiseVolume({20, 9, 9}, {kFloat}, 0, 1);
  const TypedVolume b = NoiseVolume({90, 90, 90}, {kFloat}, 0, 2);
  signal(SIGXFSZ, SIG_IGN);
  rlimit unlimited{};
  ASSERT_EQ(getrlimit(RLIMIT_FSIZE, &unlimited), 0);
  for (const NamedSave& to : kSaves) {
    to.save(a, Path(to.name), false, {});
    const std::string before = test::TextOf(Path(to.name));
    for (const rlim_t bytes : {0, 100, 5000, 300000}) {
      const rlimit limit{bytes, unlimited.rlim_max};
      ASSERT_EQ(setrlimit(RLIMIT_FSIZE, &limit), 0);
      const auto refusal = Refusal([&] { to.save(b, Path(to.name), true, {}); });
      ASSERT_EQ(setrlimit(RLIMIT_FSIZE, &unlimited), 0);
      EXPECT_EQ(refusal, ErrorKind::kDiskFull) << to.name << bytes;
      EXPECT_EQ(test::TextOf(Path(to.name)), before);
    }
  }
  EXPECT_EQ(std::distance(fs::directory_iterator(folder_.path()), {}), 2);
}

}  // namespace

}  // namespace palpate::client
