// The lab on whole volumes.
//
// The promise of the decompositions: H has the topology of the trilinear surface. Held against
// published grids, and over whole volumes against a count that knows no decomposition.
// unit/isosurface_test.cpp has the single cells.
//
// A minute of sliding below the surface, at two speeds and two scales and on real volumes: no
// fall-through, no stick, no force that the surface does not explain.
#include <gtest/gtest.h>

#include <algorithm>
#include <cstdio>
#include <filesystem>
#include <fstream>
#include <map>
#include <memory>
#include <sstream>
#include <string>
#include <vector>

#include "server/lab/commands.h"
#include "server/lab/lab_arguments.h"
#include "server/lab/mesh.h"
#include "server/lab/mesh_statistics.h"
#include "server/lab/trajectory.h"
#include "server/lab/trilinear_topology.h"
#include "tests/support/data_folder.h"
#include "tests/support/made_volume.h"
#include "tests/support/places.h"

namespace palpate::lab {
namespace {

using testing::KnownSurface;

constexpr auto kTpbcc = ComparedMethod::kTpbcc;
// Rows without comments, split at commas and blanks.
std::vector<std::vector<std::string>> ReadGridRows(const std::filesystem::path& path) {
  std::vector<std::vector<std::string>> rows;
  std::ifstream in(path);
  for (std::string line; std::getline(in, line);) {
    if (line.empty() || line[0] == '#') continue;
    std::replace(line.begin(), line.end(), ',', ' ');
    std::istringstream fields(line);
    rows.emplace_back();
    for (std::string field; fields >> field;) rows.back().push_back(field);
  }
  return rows;
}

// id, b0, total genus, then the 27 inner values of a 5x5x5 grid, x fastest, whose
// border is +1.
std::shared_ptr<const VolumeSnapshot> MakeClosedGrid(const std::vector<std::string>& row) {
  return testing::MakeVolume(Vec3i::Constant(5), [&](int i, int j, int k) {
    if (i % 4 == 0 || j % 4 == 0 || k % 4 == 0) return 1.0;
    return std::stod(row[static_cast<std::size_t>(3 + (i - 1) + 3 * (j - 1) + 9 * (k - 1))]);
  });
}

TEST(LabTopology, PublishedClosedGrids) {
  const auto path = std::filesystem::path(test::kSharedCells) / "published_closed.txt";
  if (!std::filesystem::exists(path)) GTEST_SKIP() << path << " is missing";
  const auto rows = ReadGridRows(path);
  ASSERT_GT(rows.size(), 3000u);
  const CellRange range{Vec3i::Zero(), Vec3i::Constant(4)};
  std::map<ComparedMethod, int> wrong;
  int miscounted = 0;
  for (const auto& row : rows) {
    const auto grid = MakeClosedGrid(row);
    const double isovalue = grid->Normalize(0.0);
    const std::int64_t components = std::stoi(row[1]), genus = std::stoi(row[2]);
    const auto morse = CountTrilinearTopology(*grid, isovalue, range);
    miscounted += morse.surface() != 2 * (components - genus);
    for (const auto method : {kTpbcc, ComparedMethod::kBcc, ComparedMethod::kTpbccPublished}) {
      const MeshStatistics s = MeasureMesh(ExtractSurface(*grid, isovalue, method, range));
      const bool closed = s.boundary_edges == 0 && s.IsManifold();
      wrong[method] += !closed || s.components != components || s.genus() != genus;
    }
  }
  std::printf("%zu grids, wrong: tpbcc %d, bcc %d, published %d\n", rows.size(), wrong[kTpbcc],
              wrong[ComparedMethod::kBcc], wrong[ComparedMethod::kTpbccPublished]);
  EXPECT_EQ(wrong[kTpbcc], 0);
  EXPECT_GT(wrong[ComparedMethod::kBcc], 0);  // the control
  EXPECT_EQ(miscounted, 0);
}

class WholeVolumeTest : public ::testing::TestWithParam<KnownSurface> {};

TEST_P(WholeVolumeTest, HasTheTopologyOfTheTrilinearSurface) {
  const KnownSurface& param = GetParam();
  const std::string source = testing::PlaceOf(param.source);
  if (source.empty()) GTEST_SKIP() << param.source << testing::kMissing;
  const auto volume = LoadVolume(source, test::kPalpateImport);
  const MorseCount morse = CountTrilinearTopology(*volume, param.isovalue, PaddedCells(*volume));
  for (const int refinement : {1, 2}) {
    SCOPED_TRACE(refinement);
    const Lattice lattice(*volume, refinement);
    const MeshStatistics s =
        MeasureMesh(ExtractSurface(lattice, param.isovalue, kTpbcc, PaddedCells(lattice)));
    EXPECT_GT(s.triangles, 0);
    EXPECT_EQ(s.boundary_edges, 0);
    EXPECT_EQ(s.non_manifold_edges, 0);
    EXPECT_EQ(s.non_manifold_vertices, 0);
    EXPECT_EQ(s.misoriented_edges, 0);
    EXPECT_EQ(s.euler, morse.surface());
  }
}

INSTANTIATE_TEST_SUITE_P(Volumes, WholeVolumeTest, ::testing::ValuesIn(testing::kPaperSurfaces),
                         testing::kNameOf);
INSTANTIATE_TEST_SUITE_P(Builtin, WholeVolumeTest,
                         ::testing::Values(KnownSurface{"gyroid_50", "builtin:gyroid:128", 0.5}),
                         testing::kNameOf);

// --- Slides

void ExpectSound(const ReplaySummary& s) {
  const Verdict& v = s.verdict;
  EXPECT_EQ(s.ticks, 60'000);
  EXPECT_EQ(v.fall_throughs, 0);
  EXPECT_EQ(v.sticks, 0);
  EXPECT_EQ(v.unchecked_ticks, 0);
  EXPECT_EQ(v.ejecting_ticks, 0);
  EXPECT_EQ(v.iteration_cap_hits, 0);
  // Where a force is above the expected one, the surface is why.
  EXPECT_EQ(v.excess_off_minimum_ticks, 0);
  EXPECT_EQ(v.scp_v_off_ticks, 0);
}

// By its number in kFixedSlides.
class FixedSlideTest : public ::testing::TestWithParam<std::size_t> {};

TEST_P(FixedSlideTest, IsFeltWithoutFault) {
  const FixedSlide& slide = kFixedSlides[GetParam()];
  for (const int refinement : {1, 2}) {
    SCOPED_TRACE(refinement);
    const ReplaySummary s = RunFixedSlide(slide, 1, refinement);
    ExpectSound(s);
    EXPECT_EQ(s.verdict.excess_force_ticks, 0);
    EXPECT_GE(s.contact_share(), 0.99);
    EXPECT_EQ(s.scp_v_share(), 1.0);
  }
}

INSTANTIATE_TEST_SUITE_P(Volumes, FixedSlideTest,
                         ::testing::Range(std::size_t{0}, kFixedSlides.size()),
                         [](const auto& slide) {
                           return std::string(kFixedSlides[slide.param].name);
                         });

// Judged apart from the others, with nothing beside it: with room for other work on the machine.
TEST(SlideTime, AnUpdateTakesMicroseconds) {
  for (const FixedSlide& slide : kFixedSlides) {
    EXPECT_LT(RunFixedSlide(slide, 3).p50_ns, 8'000) << slide.name;
  }
}

// Noise, folds and thin walls: a proxy may be left behind by the HIP, which goes
// round a rim inside the material, and rest far from it.
class RealSlideTest : public ::testing::TestWithParam<KnownSurface> {};

TEST_P(RealSlideTest, IsFeltWithoutFault) {
  const KnownSurface& slide = GetParam();
  const std::string place = testing::PlaceOf(slide.source);
  if (place.empty()) GTEST_SKIP() << slide.source << testing::kMissing;
  const LoadedSurface loaded = LoadSurface({.volume = place,
                                            .isovalue = slide.isovalue,
                                            .normalized = true,
                                            .import_program = test::kPalpateImport});
  for (const double speed_cm_per_s : {10.0, 50.0}) {
    const auto hips_mm = MakeTrajectory(
        *loaded.volume, {.isovalue = loaded.isovalue, .speed_cm_per_s = speed_cm_per_s});
    const ReplaySummary s =
        ReplayAndJudge(loaded, DecompositionMethod::kTpbcc, HapticSettings{}, hips_mm, 1).summary;
    ExpectSound(s);
    EXPECT_GE(s.contact_share(), 0.5);
  }
}

INSTANTIATE_TEST_SUITE_P(Volumes, RealSlideTest,
                         ::testing::Values(KnownSurface{"daisy", testing::kDaisy, 0.02},
                                           KnownSurface{"orange", testing::kOrange, 0.22},
                                           KnownSurface{"lobster", testing::kLobster, 0.16},
                                           KnownSurface{"head", testing::kHead, 0.33}),
                         testing::kNameOf);

}  // namespace
}  // namespace palpate::lab
