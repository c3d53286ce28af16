// Meshes of H, and the Euler characteristic of V that they are judged by. And what palpate-lab
// reads and writes of cells.
#include <fmt/format.h>
#include <gtest/gtest.h>
#include <tbb/global_control.h>

#include <array>
#include <cmath>
#include <filesystem>
#include <memory>
#include <nlohmann/json.hpp>
#include <numbers>
#include <random>
#include <sstream>
#include <string>
#include <vector>

#include "common/error/error.h"
#include "server/lab/commands.h"
#include "server/lab/mesh.h"
#include "server/lab/mesh_files.h"
#include "server/lab/mesh_statistics.h"
#include "server/lab/trilinear_topology.h"
#include "tests/support/made_volume.h"
#include "tests/support/temporary_folder.h"

namespace palpate::lab {
namespace {

using testing::MakeVolume;

constexpr auto kTpbcc = ComparedMethod::kTpbcc;
constexpr std::array kMeshMethods = {ComparedMethod::kBcc, ComparedMethod::kTptd,
                                     ComparedMethod::kTpbccPublished, kTpbcc};

std::shared_ptr<const VolumeSnapshot> MakeSphere(int edge) {
  const double c = 0.5 * (edge - 1);
  return MakeVolume(Vec3i::Constant(edge),
                    [=](int i, int j, int k) { return -std::hypot(i - c, j - c, k - c); });
}

std::shared_ptr<const VolumeSnapshot> MakeTorus(int edge) {
  const double c = 0.5 * (edge - 1);
  return MakeVolume(Vec3i::Constant(edge), [=](int i, int j, int k) {
    return -std::hypot(std::hypot(i - c, j - c) - 0.3 * edge, k - c);
  });
}

std::shared_ptr<const VolumeSnapshot> MakeGyroid(int edge) {
  const double w = 4.0 * std::numbers::pi / edge;
  return MakeVolume(Vec3i::Constant(edge), [=](int i, int j, int k) {
    return std::sin(w * i) * std::cos(w * j) + std::sin(w * j) * std::cos(w * k) +
           std::sin(w * k) * std::cos(w * i);
  });
}

// levels: 0 for continuous values.
std::shared_ptr<const VolumeSnapshot> MakeRandom(int edge, int levels, unsigned seed) {
  std::mt19937 random(seed);
  std::uniform_real_distribution<double> uniform(0.0, 1.0);
  std::uniform_int_distribution<int> level(0, std::max(levels - 1, 0));
  return MakeVolume(Vec3i::Constant(edge), [&](int, int, int) {
    return levels == 0 ? uniform(random) : static_cast<double>(level(random));
  });
}

SurfaceMesh Extract(const VolumeSnapshot& volume, double isovalue, ComparedMethod method = kTpbcc) {
  return ExtractSurface(volume, isovalue, method, PaddedCells(volume));
}

void ExpectClosed(const MeshStatistics& s) {
  EXPECT_EQ(s.boundary_edges, 0);
  EXPECT_EQ(s.non_manifold_edges, 0);
  EXPECT_EQ(s.non_manifold_vertices, 0);
  EXPECT_EQ(s.misoriented_edges, 0);
}

// Six times the volume enclosed; positive where normals point outwards.
double EnclosedVolume(const SurfaceMesh& mesh) {
  double sum = 0.0;
  for (const auto& t : mesh.triangles) {
    sum += mesh.vertices[t[0]].dot(mesh.vertices[t[1]].cross(mesh.vertices[t[2]]));
  }
  return sum / 6.0;
}

// A closed surface with so many holes.
SurfaceMesh ExpectGenus(std::int64_t genus, const VolumeSnapshot& volume, double value,
                        ComparedMethod method = kTpbcc) {
  const double isovalue = volume.Normalize(value);
  const SurfaceMesh mesh = Extract(volume, isovalue, method);
  const MeshStatistics s = MeasureMesh(mesh);
  ExpectClosed(s);
  EXPECT_EQ(s.components, 1);
  EXPECT_EQ(s.euler, 2 - 2 * genus);
  EXPECT_EQ(s.genus(), genus);
  EXPECT_EQ(CountTrilinearTopology(volume, isovalue, PaddedCells(volume)).surface(), 2 - 2 * genus);
  return mesh;
}

TEST(LabMesh, ASphereIsOneForEveryMethodAndATorusHasOneHole) {
  const auto sphere = MakeSphere(20);
  for (ComparedMethod method : kMeshMethods) {
    SCOPED_TRACE(NameOf(method));
    EXPECT_NEAR(EnclosedVolume(ExpectGenus(0, *sphere, -7.0, method)),
                4.0 / 3.0 * std::numbers::pi * 343.0, 15.0);
  }
  ExpectGenus(1, *MakeTorus(31), -4.2);
}

TEST(LabMesh, WithoutPaddingOpensAtTheBorderOnly) {
  const auto gyroid = MakeGyroid(20);
  const CellRange inner{Vec3i::Zero(), gyroid->size() - Vec3i::Ones()};
  for (ComparedMethod method : kMeshMethods) {
    const MeshStatistics s = MeasureMesh(ExtractSurface(*gyroid, 0.5, method, inner));
    EXPECT_GT(s.boundary_edges, 0);
    EXPECT_GT(s.boundary_loops, 0);
    EXPECT_EQ(s.boundary_edges_off_border, 0);
    EXPECT_EQ(s.non_manifold_edges, 0);
    EXPECT_EQ(s.misoriented_edges, 0);
  }
  EXPECT_THROW(CountTrilinearTopology(*gyroid, 0.5, inner), Error);
}

// The number of those with another Euler characteristic.
int CountWrongRandomGrids(ComparedMethod method, int levels, int grids) {
  int wrong = 0;
  std::mt19937 random(99);
  std::uniform_real_distribution<double> isovalues(0.1, 0.9);
  for (int n = 0; n < grids; ++n) {
    const auto volume = MakeRandom(6, levels, static_cast<unsigned>(n + 1000 * levels));
    // Of tied grids every other isovalue is one of their values.
    double isovalue = isovalues(random);
    if (levels > 1 && n % 2 == 0) isovalue = static_cast<double>(n % levels) / (levels - 1);
    const MeshStatistics s = MeasureMesh(Extract(*volume, isovalue, method));
    EXPECT_EQ(s.boundary_edges + s.non_manifold_edges + s.misoriented_edges, 0) << n;
    wrong += s.euler != CountTrilinearTopology(*volume, isovalue, PaddedCells(*volume)).surface();
  }
  return wrong;
}

TEST(LabMesh, OnRandomGridsItIsClosedAndOursHasTheTopologyOfTheTrilinearSurface) {
  for (const int levels : {0, 2, 3, 5, 16, 256}) {
    EXPECT_EQ(CountWrongRandomGrids(kTpbcc, levels, 500), 0) << levels;
  }
  EXPECT_GT(CountWrongRandomGrids(ComparedMethod::kBcc, 0, 300), 0);
  CountWrongRandomGrids(ComparedMethod::kTptd, 0, 300);
}

TEST(LabMesh, SolidAroundTheBorderCountsAsWell) {
  // A hollow: the border is inside, the isosurface closed.
  std::mt19937 random(5);
  std::uniform_real_distribution<double> uniform(0.0, 1.0);
  for (int n = 0; n < 200; ++n) {
    const auto volume = MakeVolume(Vec3i::Constant(7), [&](int i, int j, int k) {
      const bool border = i % 6 == 0 || j % 6 == 0 || k % 6 == 0;
      return border ? 1.0 : uniform(random);
    });
    const CellRange range{Vec3i::Zero(), Vec3i::Constant(6)};
    const MeshStatistics s = MeasureMesh(ExtractSurface(*volume, 0.5, kTpbcc, range));
    ExpectClosed(s);
    EXPECT_EQ(s.euler, CountTrilinearTopology(*volume, 0.5, range).surface());
  }
}

TEST(LabMesh, SameForAnyNumberOfThreads) {
  const auto gyroid = MakeGyroid(30);
  SurfaceMesh alone;
  {
    const tbb::global_control limit(tbb::global_control::max_allowed_parallelism, 1);
    alone = Extract(*gyroid, 0.5);
  }
  const SurfaceMesh together = Extract(*gyroid, 0.5);
  EXPECT_EQ(alone.vertices, together.vertices);
  EXPECT_EQ(alone.triangles, together.triangles);
}

TEST(LabMesh, ProgressRisesToOne) {
  double last = 0.0;
  const auto sphere = MakeSphere(20);
  ExtractSurface(*sphere, 0.5, kTpbcc, PaddedCells(*sphere), [&](double fraction) {
    EXPECT_GT(fraction, last);
    last = fraction;
  });
  EXPECT_EQ(last, 1.0);
}

SurfaceMesh MakeMesh(std::size_t vertices, std::vector<std::array<std::uint32_t, 3>> triangles) {
  return {std::vector<Vec3>(vertices, Vec3::Constant(0.5)),
          std::move(triangles),
          {Vec3i::Zero(), Vec3i::Ones()}};
}

TEST(LabMeshStatistics, SeesWhatIsWrong) {
  // A tetrahedron's surface.
  const std::vector<std::array<std::uint32_t, 3>> closed = {
      {0, 2, 1}, {0, 1, 3}, {1, 2, 3}, {0, 3, 2}};
  MeshStatistics s = MeasureMesh(MakeMesh(4, closed));
  ExpectClosed(s);
  EXPECT_EQ(s.edges, 6);
  EXPECT_EQ(s.euler, 2);

  auto triangles = closed;
  triangles.pop_back();
  s = MeasureMesh(MakeMesh(4, triangles));
  EXPECT_EQ(s.boundary_edges, 3);
  EXPECT_EQ(s.boundary_edges_off_border, 3);
  EXPECT_EQ(s.boundary_loops, 1);
  EXPECT_EQ(s.euler, 1);
  EXPECT_EQ(s.genus(), 0);

  triangles = closed;
  std::swap(triangles[0][0], triangles[0][1]);
  EXPECT_EQ(MeasureMesh(MakeMesh(4, triangles)).misoriented_edges, 3);

  triangles = closed;  // a fin on the edge 0-1
  triangles.push_back({0, 1, 4});
  s = MeasureMesh(MakeMesh(5, triangles));
  EXPECT_EQ(s.non_manifold_edges, 1);
  EXPECT_EQ(s.boundary_edges, 2);

  triangles = closed;  // a second one that touches the first in vertex 0
  triangles.insert(triangles.end(), {{0, 5, 4}, {0, 4, 6}, {4, 5, 6}, {0, 6, 5}});
  s = MeasureMesh(MakeMesh(7, triangles));
  EXPECT_EQ(s.non_manifold_edges, 0);
  EXPECT_EQ(s.non_manifold_vertices, 1);
  EXPECT_EQ(s.components, 1);
}

class LabMeshFiles : public ::testing::Test {
 protected:
  test::TemporaryFolder temporary_;
  const std::filesystem::path folder_ = temporary_.path();
};

TEST_F(LabMeshFiles, ObjIsInWorldMm) {
  SurfaceMesh mesh;
  mesh.vertices = {{0, 0, 0}, {1, 0, 0}, {0, 1.5, 0}};
  mesh.triangles = {{0, 1, 2}};
  AffineMap X_WI{Vec3(2, 2, 3).asDiagonal(), Vec3(10, 0, -5)};
  WriteMesh(mesh, X_WI, folder_ / "a.obj", IfThere::kReplace);
  EXPECT_EQ(test::TextOf(folder_ / "a.obj"),
            "# palpate-lab: world mm, LPS\nv 10 0 -5\nv 12 0 -5\nv 10 3 -5\nf 1 2 3\n");
  X_WI.linear(2, 2) = -3;  // a mirror turns the triangles over
  WriteMesh(mesh, X_WI, folder_ / "a.OBJ", IfThere::kReplace);
  EXPECT_NE(test::TextOf(folder_ / "a.OBJ").find("f 1 3 2"), std::string::npos);
}

TEST_F(LabMeshFiles, PlyIsBinary) {
  SurfaceMesh mesh;
  mesh.vertices = {{0, 0, 0}, {1, 0, 0}, {0, 1, 0}};
  mesh.triangles = {{0, 1, 2}};
  WriteMesh(mesh, AffineMap{}, folder_ / "a.ply", IfThere::kReplace);
  const std::string text = test::TextOf(folder_ / "a.ply");
  const std::string end = "end_header\n";
  EXPECT_TRUE(text.starts_with("ply\nformat binary_little_endian 1.0\n"));
  EXPECT_NE(text.find("element vertex 3\n"), std::string::npos);
  EXPECT_NE(text.find("element face 1\n"), std::string::npos);
  EXPECT_EQ(text.size(), text.find(end) + end.size() + 3 * 24 + 13);
}

TEST_F(LabMeshFiles, ErrorsAreClearAndLeaveNothing) {
  EXPECT_THROW(WriteMesh({}, AffineMap{}, folder_ / "a.stl", IfThere::kReplace), Error);
  EXPECT_THROW(WriteMesh({}, AffineMap{}, folder_ / "missing" / "a.ply", IfThere::kReplace), Error);
  std::filesystem::create_directories(folder_ / "taken.ply" / "x");
  EXPECT_THROW(WriteMesh({}, AffineMap{}, folder_ / "taken.ply", IfThere::kReplace), Error);
  EXPECT_FALSE(std::filesystem::exists(folder_ / "taken.ply.partial"));
}

TEST_F(LabMeshFiles, TheCommandCountsAndWrites) {
  MeshOptions options;
  options.volume = "builtin:sphere:32";
  options.normalized_isovalue = 0.5;
  options.output = folder_ / "sphere.ply";
  ::testing::internal::CaptureStdout();
  EXPECT_EQ(RunMesh(options), 0);
  const std::string out = ::testing::internal::GetCapturedStdout();
  EXPECT_NE(out.find("Euler characteristic         2\n"), std::string::npos) << out;
  EXPECT_NE(out.find("boundary edges               0\n"), std::string::npos) << out;
  EXPECT_TRUE(std::filesystem::exists(options.output));

  options.isovalue = 0.5;  // both
  EXPECT_THROW(RunMesh(options), Error);
  options.normalized_isovalue.reset();
  options.isovalue = 2.0;
  EXPECT_THROW(RunMesh(options), Error);
  options.isovalue = 0.5;
  options.method = "marching";
  EXPECT_THROW(RunMesh(options), Error);
}

// --- Cells

using Json = nlohmann::json;

std::vector<Json> Decomposed(const std::string& input, ComparedMethod method,
                             const VolumeSnapshot* volume = nullptr) {
  std::istringstream in(input);
  std::ostringstream out;
  DecomposeCells(in, out, method, volume);
  std::vector<Json> cells;
  std::istringstream lines(out.str());
  for (std::string line; std::getline(lines, line);) cells.push_back(Json::parse(line));
  return cells;
}

std::string Refusal(const std::string& input) {
  try {
    Decomposed(input, ComparedMethod::kTpbcc);
  } catch (const Error& error) {
    EXPECT_EQ(error.kind(), ErrorKind::kInvalidArgument);
    return error.what();
  }
  return "accepted";
}

TEST(LabCells, ReadsCommasBlanksAndFurtherColumns) {
  const auto cells = Decomposed(
      "# a comment\n"
      "0.41,0.87,0.14,0.12,0.24,0.15,0.10,0.08,0.18,more\n"
      "\n"
      "0 1 0 1 1 0 1 0\r\n"
      "  +1e-3\t2, 3 4 5 6 7 -8e2\n",
      ComparedMethod::kTpbcc);
  ASSERT_EQ(cells.size(), 3u);
  EXPECT_EQ(cells[1]["sigma_f"], 6);
  EXPECT_EQ(cells[1]["tetrahedra"][0].size(), 4u);
  EXPECT_EQ(cells[0]["vertices"].size(), 14u);  // a diamond
  EXPECT_EQ(cells[0]["vertices"][0].size(), 4u);
  // Corner d1 is at (0, 0, 1) and keeps its density but for the tie step.
  EXPECT_EQ(cells[0]["vertices"][1][2], 1.0);
  EXPECT_NEAR(cells[0]["vertices"][1][3].get<double>(), 0.87, 1e-8);
  EXPECT_LT(cells[0]["vertices"][1][3].get<double>(), 0.87);
}

TEST(LabCells, NamesTheLineOfAnError) {
  EXPECT_TRUE(Refusal("0 1 2 3 4 5 6 7\n\n1 2 3\n").starts_with("line 3: "));
  EXPECT_NE(Refusal("0 1 2 3 4 5 6 x7\n").find("'x7'"), std::string::npos);
  // An empty column must not let the later ones slide in.
  for (const char* line : {"0 1 2 3 4 5 6 x7\n", "0 1 2 3 4 5 6 nan\n", "0 1 2 3 4 5 6 1e999\n",
                           "0,0.1,,0.3,0.4,0.5,0.6,0.7,0.42\n"}) {
    EXPECT_TRUE(Refusal(line).starts_with("line 1: ")) << line;
  }
}

TEST(LabCells, CornersAreNeverRaised) {
  // One unit in the last place apart: a corner raised by rounding would turn a
  // value equal to the isovalue into tissue.
  std::string line;
  for (int k = 0; k < 8; ++k) line += fmt::format("{} ", 1.0 + k * 0x1p-52);
  const auto cells =
      Decomposed(line + "\n1e-9 1e-9 1e-9 1e-9 1e-9 1e-9 1e-9 1e-9\n", ComparedMethod::kTpbcc);
  ASSERT_EQ(cells.size(), 2u);
  for (int k = 0; k < 8; ++k) {
    EXPECT_EQ(cells[0]["vertices"][k][3].get<double>(), 1.0 + k * 0x1p-52);
    EXPECT_NEAR(cells[1]["vertices"][k][3].get<double>(), 1e-9, 1e-16);
  }
}

TEST(LabCells, TakesAnyFiniteDensities) {
  for (const char* line : {"0 0 0 0 0 0 0 0", "1e308 -1e308 1e308 -1e308 0 0 0 1",
                           "1e-320 2e-320 3e-320 0 1e-320 5e-324 0 0", "-7 -7 -7 -7 -7 -7 -7 -6"}) {
    const auto cells = Decomposed(std::string(line) + "\n", ComparedMethod::kTpbcc);
    ASSERT_EQ(cells.size(), 1u);
    for (const Json& vertex : cells[0]["vertices"]) {
      for (const Json& number : vertex) ASSERT_TRUE(number.is_number()) << line;
    }
  }
}

TEST(LabCells, OfAVolumeAreTheRenderersOwn) {
  const auto volume = testing::MakeVolume(
      Vec3i(4, 4, 4), [](int i, int j, int k) { return (i * 7 + j * 3 + k) % 4; });
  const auto cells = Decomposed("1,2,0\n-1 -1 -1\n", ComparedMethod::kTpbcc, volume.get());
  ASSERT_EQ(cells.size(), 2u);
  const Decomposition expected =
      Decompose(volume->ResolvedCell(Vec3i(1, 2, 0)), ComparedMethod::kTpbcc);
  for (int v = 0; v < 15; ++v) {
    EXPECT_EQ(cells[0]["vertices"][v][3].get<double>(), expected.density[v]);
    EXPECT_EQ(cells[0]["vertices"][v][1].get<double>(), expected.position[v].y());
  }
  std::istringstream in("9 9 9\n");
  std::ostringstream out;
  EXPECT_THROW(DecomposeCells(in, out, ComparedMethod::kTpbcc, volume.get()), Error);
}

}  // namespace
}  // namespace palpate::lab
