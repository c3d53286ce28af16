// Saved volumes load again as they were, whatever happens while they are written.
#include "server/volume/save/volume_export.h"

#include <gtest/gtest.h>
#include <signal.h>
#include <sys/resource.h>

#include <algorithm>
#include <bit>
#include <chrono>
#include <fstream>
#include <functional>
#include <limits>
#include <random>
#include <thread>
#include <utility>
#include <vector>

#include "server/volume/load/import_process.h"
#include "server/volume/save/volume_file.h"
#include "tests/support/patterned_volume.h"
#include "tests/support/places.h"
#include "tests/support/process.h"
#include "tests/support/refusal.h"
#include "tests/support/temporary_folder.h"
#include "tests/support/vdb_grids.h"
#include "tests/support/voxels.h"

namespace palpate {
namespace {

using testing::ObliqueVolume;
using testing::Refusal;
using testing::ValueAt;

const ExportProgress kQuiet = [](std::string_view, double) {};
const ExportCancelled kNever = [] { return false; };
constexpr const char* kNames[] = {"a.vdb", "a.nrrd"};

class VolumeExportTest : public ::testing::Test {
 protected:
  std::filesystem::path Path(const std::string& name) const { return folder_.path() / name; }

  static void Save(const VolumeSnapshot& volume, const std::filesystem::path& path,
                   bool overwrite = false) {
    ExportVolume(volume, {path, overwrite, test::kPalpateImport}, kQuiet, kNever);
  }
  static std::shared_ptr<const VolumeSnapshot> Loaded(const std::filesystem::path& path) {
    ImportRequest request;
    request.source = path;
    request.import_program = test::kPalpateImport;
    const LoadedVolume volume = ImportVolume(request, {}, {});
    return std::make_shared<VolumeSnapshot>(volume.metadata, volume.bricks, 1, 1);
  }
  std::size_t FileCount() const {
    return static_cast<std::size_t>(
        std::distance(std::filesystem::directory_iterator(folder_.path()), {}));
  }

  test::TemporaryFolder folder_;
};

void ExpectSame(const VolumeSnapshot& a, const VolumeSnapshot& b) {
  const VolumeMetadata &m = a.metadata(), &n = b.metadata();
  ASSERT_EQ(m.size, n.size);
  testing::ForEachVoxel(m.size, [&](const Vec3i& p) {
    ASSERT_EQ(std::bit_cast<std::uint32_t>(ValueAt(a, p)),
              std::bit_cast<std::uint32_t>(ValueAt(b, p)));
  });
  EXPECT_TRUE(m.spacing_mm.isApprox(n.spacing_mm, 1e-14));
  EXPECT_TRUE(m.origin_W_mm.isApprox(n.origin_W_mm, 1e-14));
  EXPECT_TRUE(m.direction.isApprox(n.direction, 1e-14));
  EXPECT_EQ(m.unit, n.unit);
  EXPECT_EQ(m.patient_axes, n.patient_axes);
}

VolumeSnapshot WithMetadata(const VolumeSnapshot& volume, const VolumeMetadata& metadata) {
  return {metadata, volume.bricks(), 1, 1};
}

TEST_F(VolumeExportTest, LoadsAgainBitForBit) {
  unsigned seed = 0;
  for (const char* name : kNames) {
    for (const Vec3i& size : {Vec3i(2, 2, 2), Vec3i(33, 40, 17), Vec3i(8, 64, 9)}) {
      auto volume = ObliqueVolume(size, ++seed);
      if (seed % 2) {
        VolumeMetadata metadata = volume->metadata();
        metadata.patient_axes = "LPS";
        volume = std::make_shared<VolumeSnapshot>(metadata, volume->bricks(), 1, 1);
      }
      Save(*volume, Path(name), true);
      const auto loaded = Loaded(Path(name));
      ExpectSame(*volume, *loaded);
      EXPECT_EQ(loaded->metadata().value_min, volume->metadata().value_min);
      EXPECT_EQ(FileCount(), 1u);
    }
    std::filesystem::remove(Path(name));
  }
}

// Bricks of these types by turns.
std::shared_ptr<const VolumeSnapshot> Typed(const std::vector<LeafType>& types) {
  std::size_t count = 0;
  const auto leaf = [&](const Vec3i&) {
    const LeafType type = types[count++ % types.size()];
    Brick values;
    for (std::size_t n = 0; n < values.size(); ++n) values[n] = static_cast<float>(n % 251);
    if (type == LeafType::kInt16) values[0] = -30000.0f;
    if (type == LeafType::kUint16) values[0] = 60000.0f;
    if (type == LeafType::kFloat) values[0] = 0.25f;
    return Leaf::Of(type, values);
  };
  return testing::VolumeOfLeaves(Vec3i(21, 16, 9), leaf, -30000.0, 60000.0);
}

TEST_F(VolumeExportTest, AnNrrdFileHasTheSmallestTypeThatHoldsAll) {
  using enum LeafType;
  const std::pair<std::vector<LeafType>, LeafType> kCases[] = {
      {{kUint8}, kUint8},          {{kInt16}, kInt16},         {{kUint16}, kUint16},
      {{kFloat}, kFloat},          {{kUint8, kInt16}, kInt16}, {{kUint16, kUint8}, kUint16},
      {{kInt16, kUint16}, kFloat}, {{kUint8, kFloat}, kFloat},
  };
  for (const auto& [types, type] : kCases) {
    const auto volume = Typed(types);
    Save(*volume, Path("a.nrrd"), true);
    const auto loaded = Loaded(Path("a.nrrd"));
    ExpectSame(*volume, *loaded);
    EXPECT_EQ(loaded->bricks().At(Vec3i(0, 0, 0))->type(), type) << static_cast<int>(type);
  }
}

TEST_F(VolumeExportTest, AVdbFileKeepsAllThatIsKnownOfTheVolume) {
  const auto plain = ObliqueVolume(Vec3i(20, 11, 9), 3);
  VolumeMetadata metadata = plain->metadata();
  metadata.spacing_mm = kLeastSpacingMm * Vec3(1.01, 1.01, 2.0);
  metadata.frames = 20;
  metadata.original_type = "int16";
  const VolumeSnapshot volume = WithMetadata(*plain, metadata);
  Save(volume, Path("a.vdb"));
  const auto loaded = Loaded(Path("a.vdb"));
  ExpectSame(volume, *loaded);
  EXPECT_EQ(loaded->metadata().frames, 20);
  EXPECT_EQ(loaded->metadata().original_type, "int16");
  // What other programs find.
  const auto grid = openvdb::gridPtrCast<openvdb::FloatGrid>(testing::ReadVdb(Path("a.vdb")));
  ASSERT_NE(grid, nullptr);
  EXPECT_EQ(grid->getName(), "density");
  for (const Vec3i& p : {Vec3i(0, 0, 0), Vec3i(3, 4, 5), Vec3i(19, 10, 8)}) {
    EXPECT_EQ(grid->tree().getValue({p.x(), p.y(), p.z()}), ValueAt(volume, p));
    const Vec3 expected = metadata.WorldFromIndex().Apply(p.cast<double>());
    const openvdb::Vec3d p_W = grid->indexToWorld(openvdb::Vec3d(p.x(), p.y(), p.z()));
    for (int k = 0; k < 3; ++k) EXPECT_NEAR(p_W[k], expected[k], 1e-12);
  }
}

TEST_F(VolumeExportTest, WhatIsNoVolumeIsNotWritten) {
  const auto volume = ObliqueVolume(Vec3i(20, 11, 9), 3);
  const double nan = std::numeric_limits<double>::quiet_NaN();
  const std::function<void(VolumeMetadata&)> attacks[] = {
      [](VolumeMetadata& m) { m.size.x() = 1; },
      [](VolumeMetadata& m) { m.size.y() = -5; },
      [](VolumeMetadata& m) { m.spacing_mm.x() = 0.0; },
      [nan](VolumeMetadata& m) { m.spacing_mm.z() = nan; },
      [nan](VolumeMetadata& m) { m.origin_W_mm.z() = nan; },
      [nan](VolumeMetadata& m) { m.direction(1, 1) = nan; },
      [](VolumeMetadata& m) { m.direction(0, 1) = 0.3; },  // sheared
      [](VolumeMetadata& m) { m.direction.setZero(); },
      [](VolumeMetadata& m) { m.value_max = m.value_min; },
      [](VolumeMetadata& m) { m.source.assign(5000, 'x'); },
      [](VolumeMetadata& m) { m.patient_axes = "LRS"; },
  };
  for (const auto& attack : attacks) {
    VolumeMetadata metadata = volume->metadata();
    attack(metadata);
    EXPECT_EQ(Refusal([&] { WriteVolumeFile(Path("a.vdb"), volume->bricks(), metadata); }),
              ErrorKind::kInvalidArgument);
    EXPECT_EQ(FileCount(), 0u);
  }
}

TEST_F(VolumeExportTest, SavesReportTheirSizeAndProgress) {
  const auto volume = ObliqueVolume(Vec3i(120, 120, 120), 3);
  for (const char* name : kNames) {
    std::vector<double> fractions;
    const std::uint64_t bytes = ExportVolume(
        *volume, {Path(name), false, test::kPalpateImport},
        [&](std::string_view, double f) { fractions.push_back(f); }, kNever);
    EXPECT_EQ(bytes, std::filesystem::file_size(Path(name)));
    EXPECT_GE(fractions.size(), 4u);
    EXPECT_TRUE(std::is_sorted(fractions.begin(), fractions.end()));
    EXPECT_EQ(fractions.front(), 0.0);
    EXPECT_EQ(fractions.back(), 1.0);
  }
}

TEST_F(VolumeExportTest, TextsOfTheFileDoNotBreakTheHeader) {
  const auto plain = ObliqueVolume(Vec3i(9, 9, 9), 4);
  VolumeMetadata metadata = plain->metadata();
  metadata.unit = "a\"b\n\ndata file: /etc/passwd";
  Save(WithMetadata(*plain, metadata), Path("a.nrrd"));
  EXPECT_EQ(Loaded(Path("a.nrrd"))->metadata().unit, "abdata file: /etc/passwd");
}

TEST_F(VolumeExportTest, BadPathsAreRefused) {
  const auto volume = ObliqueVolume(Vec3i(9, 9, 9), 4);
  std::filesystem::create_directory(Path("folder.vdb"));
  for (const std::filesystem::path& bad :
       {Path("a"), Path("a.nii"), Path("a.vdb.gz"), Path(".vdb"), Path("none/a.vdb"),
        Path("folder.vdb"), std::filesystem::path("a.vdb"), std::filesystem::path(""),
        Path(std::string("a\0b.vdb", 7))}) {
    EXPECT_EQ(Refusal([&] { Save(*volume, bad, true); }), ErrorKind::kInvalidArgument) << bad;
  }
  EXPECT_EQ(FileCount(), 1u);
  Save(*volume, Path("A.VDB"));
  Save(*volume, Path("A.Nrrd"));
}

TEST_F(VolumeExportTest, AFileThatIsThereIsKeptUnlessItMayBeOverwritten) {
  const auto a = ObliqueVolume(Vec3i(9, 9, 9), 4), b = ObliqueVolume(Vec3i(9, 9, 9), 5);
  for (const char* name : kNames) {
    Save(*a, Path(name));
    EXPECT_EQ(Refusal([&] { Save(*b, Path(name)); }), ErrorKind::kConflict);
    ExpectSame(*a, *Loaded(Path(name)));
    Save(*b, Path(name), true);
    ExpectSame(*b, *Loaded(Path(name)));
  }
  EXPECT_EQ(FileCount(), 2u);
}

TEST_F(VolumeExportTest, CancelledAtAnyTimeLeavesTheOldFileAndNothingElse) {
  const auto a = ObliqueVolume(Vec3i(9, 9, 9), 4);
  const auto b = ObliqueVolume(Vec3i(128, 128, 64), 5);
  for (const char* name : kNames) {
    for (const double at : {0.0, 0.01, 0.3, 0.55}) {
      Save(*a, Path(name), true);
      double done = 0.0;
      const auto progress = [&done](std::string_view, double fraction) { done = fraction; };
      EXPECT_EQ(Refusal([&] {
                  ExportVolume(*b, {Path(name), true, test::kPalpateImport}, progress,
                               [&] { return done >= at; });
                }),
                ErrorKind::kCancelled);
      ExpectSame(*a, *Loaded(Path(name)));
      EXPECT_EQ(FileCount(), 1u);
    }
    std::filesystem::remove(Path(name));
  }
}

// Too little memory ends the writer, not this process: OpenVDB gives none back then.
TEST_F(VolumeExportTest, ASaveWithoutMemoryIsRefusedAtAnyLimit) {
#ifdef PALPATE_SANITIZED
  GTEST_SKIP() << "sanitizers take address space of their own";
#endif
  const auto a = ObliqueVolume(Vec3i(9, 9, 9), 4), b = ObliqueVolume(Vec3i(200, 200, 200), 5);
  Save(*a, Path("a.vdb"));
  const test::TemporaryFolder programs;
  const std::filesystem::path limited = programs.path() / "limited";
  int refused = 0;
  for (int mib = 200; mib > 0; mib -= 8) {
    std::ofstream(limited) << "#!/bin/sh\nulimit -v " << 1024 * mib << "\nexec "
                           << test::kPalpateImport << " \"$@\"\n";
    std::filesystem::permissions(limited, std::filesystem::perms::owner_all);
    const auto refusal = Refusal([&] {
      ExportVolume(*b, {Path("a.vdb"), true, limited}, kQuiet, kNever);
    });
    if (!refusal) {
      Save(*a, Path("a.vdb"), true);
      continue;
    }
    ++refused;
    ExpectSame(*a, *Loaded(Path("a.vdb")));
    // With less, the program does not even start.
    if (refusal != ErrorKind::kTooLarge) break;
  }
  EXPECT_GT(refused, 3);
  EXPECT_EQ(FileCount(), 1u);
}

// Files may grow to a limit here, as on a disk that fills up.
TEST_F(VolumeExportTest, AFullDiskIsSaidAndLeavesTheOldFile) {
  const auto a = ObliqueVolume(Vec3i(9, 9, 9), 4), b = ObliqueVolume(Vec3i(64, 64, 64), 5);
  signal(SIGXFSZ, SIG_IGN);
  rlimit limit{};
  ASSERT_EQ(getrlimit(RLIMIT_FSIZE, &limit), 0);
  const rlimit unlimited = limit;
  for (const char* name : kNames) {
    Save(*a, Path(name));
    for (const rlim_t bytes : {0, 100, 5000, 300000}) {
      limit.rlim_cur = bytes;
      ASSERT_EQ(setrlimit(RLIMIT_FSIZE, &limit), 0);
      const auto refusal = Refusal([&] { Save(*b, Path(name), true); });
      ASSERT_EQ(setrlimit(RLIMIT_FSIZE, &unlimited), 0);
      EXPECT_EQ(refusal, ErrorKind::kDiskFull) << name << bytes;
      ExpectSame(*a, *Loaded(Path(name)));
    }
  }
  EXPECT_EQ(FileCount(), 2u);
}

TEST_F(VolumeExportTest, KilledAtAnyMomentTheFileIsOneOfTheTwo) {
  const auto a = ObliqueVolume(Vec3i(48, 40, 33), 0), b = ObliqueVolume(Vec3i(48, 40, 33), 1);
  std::mt19937 random(7);
  for (const char* name : kNames) {
    int of_a = 0, of_b = 0;
    for (int round = 0; round < 30; ++round) {
      test::Process child({test::kVdbTool, "save", Path(name), test::kPalpateImport});
      ASSERT_TRUE(child.WaitFor("saved"));
      // Longer and longer: beside other programs a file takes its time.
      std::this_thread::sleep_for(std::chrono::microseconds(random() % (20000 * (round + 1))));
      child.Signal(SIGKILL);
      EXPECT_EQ(child.Wait().exit_code, -SIGKILL);
      const auto loaded = Loaded(Path(name));
      const bool is_a = loaded->metadata().direction.isApprox(a->metadata().direction, 1e-6);
      ExpectSame(is_a ? *a : *b, *loaded);
      ++(is_a ? of_a : of_b);
    }
    EXPECT_GT(of_a, 0);
    EXPECT_GT(of_b, 0);
    // What was cut off is gone. What was killed in the moment before the rename is whole.
    for (const auto& entry : std::filesystem::directory_iterator(folder_.path())) {
      const std::filesystem::path left = entry.path();
      if (left == Path(name)) continue;
      ASSERT_EQ(left.extension(), ".partial");
      std::filesystem::rename(left, Path(name));
      const auto loaded = Loaded(Path(name));
      const bool is_a = loaded->metadata().direction.isApprox(a->metadata().direction, 1e-6);
      ExpectSame(is_a ? *a : *b, *loaded);
    }
    std::filesystem::remove(Path(name));
  }
}

}  // namespace
}  // namespace palpate
