// palpate-lab cells: input and output.
#include <fmt/format.h>
#include <gtest/gtest.h>

#include <nlohmann/json.hpp>
#include <sstream>

#include "common/error/error.h"
#include "server/lab/cells_command.h"
#include "tests/support/made_volume.h"

namespace palpate::lab {
namespace {

using Json = nlohmann::json;

std::vector<Json> Decomposed(const std::string& input, DecompositionMethod method,
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
    Decomposed(input, DecompositionMethod::kTpbcc);
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
      DecompositionMethod::kTpbcc);
  ASSERT_EQ(cells.size(), 3u);
  EXPECT_EQ(cells[1]["sigma_f"], 6);
  EXPECT_EQ(cells[1]["tetrahedra"][0].size(), 4u);
  EXPECT_EQ(cells[0]["vertices"].size(), 15u);
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
      Decomposed(line + "\n1e-9 1e-9 1e-9 1e-9 1e-9 1e-9 1e-9 1e-9\n", DecompositionMethod::kTpbcc);
  ASSERT_EQ(cells.size(), 2u);
  for (int k = 0; k < 8; ++k) {
    EXPECT_EQ(cells[0]["vertices"][k][3].get<double>(), 1.0 + k * 0x1p-52);
    EXPECT_NEAR(cells[1]["vertices"][k][3].get<double>(), 1e-9, 1e-16);
  }
}

TEST(LabCells, TakesAnyFiniteDensities) {
  for (const char* line : {"0 0 0 0 0 0 0 0", "1e308 -1e308 1e308 -1e308 0 0 0 1",
                           "1e-320 2e-320 3e-320 0 1e-320 5e-324 0 0", "-7 -7 -7 -7 -7 -7 -7 -6"}) {
    const auto cells = Decomposed(std::string(line) + "\n", DecompositionMethod::kTpbcc);
    ASSERT_EQ(cells.size(), 1u);
    for (const Json& vertex : cells[0]["vertices"]) {
      for (const Json& number : vertex) ASSERT_TRUE(number.is_number()) << line;
    }
  }
}

TEST(LabCells, OfAVolumeAreTheRenderersOwn) {
  const auto volume = testing::MakeVolume(
      Vec3i(4, 4, 4), [](int i, int j, int k) { return (i * 7 + j * 3 + k) % 4; });
  const auto cells = Decomposed("1,2,0\n-1 -1 -1\n", DecompositionMethod::kTpbcc, volume.get());
  ASSERT_EQ(cells.size(), 2u);
  const Decomposition expected =
      Decompose(volume->ResolvedCell(Vec3i(1, 2, 0)), DecompositionMethod::kTpbcc);
  for (int v = 0; v < 15; ++v) {
    EXPECT_EQ(cells[0]["vertices"][v][3].get<double>(), expected.density[v]);
    EXPECT_EQ(cells[0]["vertices"][v][1].get<double>(), expected.position[v].y());
  }
  std::istringstream in("9 9 9\n");
  std::ostringstream out;
  EXPECT_THROW(DecomposeCells(in, out, DecompositionMethod::kTpbcc, volume.get()), Error);
}

}  // namespace
}  // namespace palpate::lab
