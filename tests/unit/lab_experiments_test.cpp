// The lab's experiments: their instruments against known values, and the bounds
// that our decomposition must keep.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <filesystem>
#include <fstream>
#include <iterator>
#include <random>
#include <sstream>
#include <string>
#include <vector>

#include "common/error/error.h"
#include "server/lab/accuracy.h"
#include "server/lab/cell_topology.h"
#include "server/lab/drift.h"
#include "server/lab/experiments.h"
#include "server/lab/published_table.h"
#include "server/lab/wilcoxon.h"
#include "tests/support/places.h"
#include "tests/support/scaled.h"
#include "tests/support/temporary_folder.h"

namespace palpate::lab {
namespace {

constexpr ComparedMethod kAllMethods[] = {ComparedMethod::kBcc, ComparedMethod::kTptd,
                                          ComparedMethod::kTpbccPublished, ComparedMethod::kTpbcc};

CellDensities CellOf(double (*value)(const Vec3&)) {
  CellDensities d;
  for (int v = 0; v < 8; ++v) {
    d[v] = value(Vec3(kCornerOffset[v][0], kCornerOffset[v][1], kCornerOffset[v][2]));
  }
  return d;
}

TEST(Wilcoxon, ExactForFewPairs) {
  const std::vector<double> zero(10, 0.0);
  std::vector<double> first(10);
  for (int n = 0; n < 10; ++n) first[n] = n + 1;
  const SignedRankResult all = SignedRankTest(first, zero);
  EXPECT_TRUE(all.exact);
  EXPECT_EQ(all.pairs, 10);
  EXPECT_EQ(all.w_plus, 55.0);
  EXPECT_EQ(all.w_minus, 0.0);
  EXPECT_DOUBLE_EQ(all.p_value, 2.0 / 1024.0);
  // Table of critical values: n = 10, W = 8 is the last with p <= 0.05.
  first[7] = -first[7];
  EXPECT_NEAR(SignedRankTest(first, zero).p_value, 2.0 * 25.0 / 1024.0, 1e-15);
}

TEST(Wilcoxon, NormalApproximationWithTies) {
  // A textbook sample: one pair without difference, two differences of 5.
  const std::vector<double> first = {125, 115, 130, 140, 140, 115, 140, 125, 140, 135};
  const std::vector<double> second = {110, 122, 125, 120, 140, 124, 123, 137, 135, 145};
  const SignedRankResult result = SignedRankTest(first, second);
  EXPECT_FALSE(result.exact);
  EXPECT_EQ(result.pairs, 9);
  EXPECT_EQ(result.w_plus, 27.0);
  EXPECT_EQ(result.w_minus, 18.0);
  EXPECT_NEAR(result.p_value, 0.5936, 5e-5);
}

TEST(Wilcoxon, EqualSamplesDoNotDiffer) {
  const std::vector<double> sample = {1.0, 2.0, 3.0};
  EXPECT_EQ(SignedRankTest(sample, sample).pairs, 0);
  EXPECT_EQ(SignedRankTest(sample, sample).p_value, 1.0);
}

TEST(Accuracy, PlanesAreExact) {
  const CellDensities d =
      CellOf([](const Vec3& p) { return 0.1 + 0.2 * p.x() + 0.3 * p.y() + 0.4 * p.z(); });
  for (ComparedMethod method : kAllMethods) {
    const Accuracy accuracy = MeasureAccuracy(d, 0.47, Decompose(d, method), 50);
    EXPECT_NEAR(accuracy.difference, 0.0, 1e-9);
    EXPECT_NEAR(accuracy.overlap, 0.0, 1e-9);
    EXPECT_NEAR(accuracy.gap, 0.0, 1e-9);
  }
}

// F = x z. TPTD splits along diagonals that lie in x = z, where PL = min(x, z).
// τ = ¼: PL is above where x and z are above ¼, 9/16; F where x z is above ¼,
// 1 - ¼ (1 + ln 4).
TEST(Accuracy, EqualsAnAnalyticVolume) {
  const CellDensities d = CellOf([](const Vec3& p) { return p.x() * p.z(); });
  const double expected = 100.0 * (9.0 / 16.0 - (1.0 - 0.25 * (1.0 + std::log(4.0))));
  EXPECT_NEAR(DifferenceOf(d, 0.25, ComparedMethod::kTptd, 1000), expected, 2e-3);
}

TEST(Accuracy, SeesOverlapsAndGaps) {
  // Case 13.1: six face saddles that do not pair up.
  const CellDensities d = {0.95, 0.05, 0.81, 0.02, 0.11, 0.91, 0.06, 0.88};
  const Accuracy published =
      MeasureAccuracy(d, 0.34, Decompose(d, ComparedMethod::kTpbccPublished), 100);
  EXPECT_GT(published.overlap, 1.0);
  EXPECT_GT(published.gap, 1.0);
  const Accuracy ours = MeasureAccuracy(d, 0.34, Decompose(d, ComparedMethod::kTpbcc), 100);
  EXPECT_NEAR(ours.overlap, 0.0, 1e-9);
  EXPECT_NEAR(ours.gap, 0.0, 1e-9);
}

TEST(Table4, PublishedFiguresAreMet) {
  const auto rows = ReadPublishedTable(std::filesystem::path(test::kCells) / "table4.csv");
  ASSERT_EQ(rows.size(), 29u);
  int tptd_met = 0;
  double sum = 0.0;
  for (const PublishedRow& row : rows) {
    for (int m = 0; m < 3; ++m) {
      if (!row.difference[m]) continue;
      const ComparedMethod method = kAllMethods[m];
      const double ours = DifferenceOf(row.d, row.isovalue, method, 200);
      const bool met = MeetsPublished(method, *row.difference[m], ours);
      if (method == ComparedMethod::kTptd) {
        tptd_met += met;
      } else {
        EXPECT_TRUE(met) << row.name << " " << kMethodNames[m];
      }
    }
    sum += DifferenceOf(row.resolved, row.isovalue, ComparedMethod::kTpbcc, 200);
  }
  std::printf("tptd met in %d rows; tpbcc mean %.3f\n", tptd_met, sum / 29.0);
  EXPECT_GE(tptd_met, 22);
  EXPECT_LE(sum / 29.0, 5.3);
}

// τ uniform in [0.2, 0.8] and within the cell's range.
double MeanDifference(bool alternating) {
  constexpr int kColumns = 20;
  const int cells = test::Scaled(20000);
  std::mt19937_64 random(1);
  std::uniform_real_distribution<double> uniform;
  double sum = 0.0;
  for (int n = 0; n < cells;) {
    const CellDensities d = RandomCell(random, alternating);
    const double isovalue = 0.2 + 0.6 * uniform(random);
    if (!IsCrossed(d, isovalue)) continue;
    sum += DifferenceOf(d, isovalue, ComparedMethod::kTpbcc, kColumns);
    ++n;
  }
  return sum / cells;
}

TEST(MeanDifference, OfTpbccKeepsItsBounds) {
  // A tenth of the cells says the mean less exactly.
  const double room = test::Scaled(20000) < 20000 ? 0.3 : 0.0;
  const double uniform = MeanDifference(false);
  const double alternating = MeanDifference(true);
  std::printf("mean R_D of tpbcc: uniform %.3f, alternating %.3f\n", uniform, alternating);
  EXPECT_LE(uniform, 2.42 + room);
  EXPECT_LE(alternating, 4.62 + room);
}

// For six face saddles: kTptd takes parallel faces, and is then right and fills the
// cell; kTpbccPublished trusts ranks, and overlaps where they mislead.
TEST(SixFaceSaddles, FaultsOfThePublishedRules) {
  std::mt19937_64 random(6);
  std::uniform_real_distribution<double> uniform;
  int cells = 0, overlaps = 0;
  while (cells < 300) {
    CellDensities d;
    for (double& x : d) x = uniform(random);
    const Decomposition tptd = Decompose(d, ComparedMethod::kTptd);
    if (tptd.face_saddle_count != 6 || tptd.body_saddle_count != 2) continue;
    ++cells;
    const Accuracy filled = MeasureAccuracy(d, 0.5, tptd, 12);
    EXPECT_NEAR(filled.overlap + filled.gap, 0.0, 1e-9);
    const Decomposition ours = Decompose(d, ComparedMethod::kTpbcc);
    for (double isovalue = 0.05; isovalue < 1.0; isovalue += 0.05) {
      EXPECT_EQ(CountCellTopology(tptd, isovalue), CountCellTopology(ours, isovalue));
    }
    const Accuracy published =
        MeasureAccuracy(d, 0.5, Decompose(d, ComparedMethod::kTpbccPublished), 12);
    overlaps += published.overlap > 1e-9;
  }
  EXPECT_GT(overlaps, cells * 4 / 10);
  EXPECT_LT(overlaps, cells * 7 / 10);
}

TEST(Drift, GbidDriftsAndOursDoesNot) {
  const auto curves = MeasureDrift(5);
  ASSERT_EQ(curves.size(), 4u);
  const auto& ours = curves[0].laps;
  const auto& own_density = curves[1].laps;
  const auto& gbid = curves[2].laps;
  const auto& corrected = curves[3].laps;
  for (std::size_t lap = 0; lap < ours.size(); ++lap) {
    EXPECT_NEAR(own_density[lap].worst, 0.0, 1e-6);
    EXPECT_LT(ours[lap].worst, 2e-3);  // H is not V, by a tenth of a voxel at most
    EXPECT_NEAR(ours[lap].isovalue, ours[0].isovalue, 1e-5);
    EXPECT_LT(corrected[lap].worst, 2e-3);
    if (lap > 0) {
      EXPECT_LT(gbid[lap].isovalue, gbid[lap - 1].isovalue - 1e-3);
    }
  }
}

class LabExperiment : public ::testing::Test {
 protected:
  void SetUp() override {
    options_.table = std::filesystem::path(test::kCells) / "table4.csv";
    options_.cells = 2000;
    options_.columns = 20;
    options_.laps = 2;
    options_.output_folder = folder_.path();
  }

  std::string Run(const std::string& name) {
    options_.name = name;
    std::ostringstream out;
    RunExperiment(options_, out);
    return out.str();
  }

  using Words = std::vector<std::string>;

  static std::vector<Words> RowsOf(const std::string& text) {
    std::vector<Words> rows;
    std::istringstream lines(text);
    for (std::string line; std::getline(lines, line);) {
      std::istringstream words(line);
      rows.emplace_back(std::istream_iterator<std::string>(words),
                        std::istream_iterator<std::string>());
    }
    return rows;
  }
  // The first that begins with `name`.
  static Words RowOf(const std::vector<Words>& rows, const std::string& name) {
    for (const Words& row : rows) {
      if (!row.empty() && row[0] == name) return row;
    }
    ADD_FAILURE() << "no row " << name;
    return {};
  }
  static std::size_t CountOf(const std::string& text, const std::string& part) {
    std::size_t count = 0;
    for (std::size_t at = text.find(part); at != std::string::npos; at = text.find(part, at + 1)) {
      ++count;
    }
    return count;
  }

  test::TemporaryFolder folder_;
  ExperimentOptions options_;
};

TEST_F(LabExperiment, Table4HasEveryCellWithItsFigure) {
  const auto rows = RowsOf(Run("table4"));
  const auto cells = ReadPublishedTable(options_.table);
  ASSERT_EQ(cells.size(), 29u);
  for (const PublishedRow& cell : cells) {
    const Words row = RowOf(rows, cell.name);
    ASSERT_GE(row.size(), 3u);
    const double ours = DifferenceOf(DensitiesFor(cell, ComparedMethod::kTpbcc), cell.isovalue,
                                     ComparedMethod::kTpbcc, options_.columns);
    EXPECT_NEAR(std::stod(row.back()), ours, 0.0051) << cell.name;
  }
}

TEST_F(LabExperiment, Table1HasTheMeansAndAllPairs) {
  const auto rows = RowsOf(Run("table1"));
  const auto cells = ReadPublishedTable(options_.table);
  for (const ComparedMethod method : kAllMethods) {
    double sum = 0.0;
    for (const PublishedRow& cell : cells) {
      sum += DifferenceOf(DensitiesFor(cell, method), cell.isovalue, method, options_.columns);
    }
    const Words row = RowOf(rows, std::string(NameOf(method)));
    ASSERT_GE(row.size(), 2u);
    EXPECT_NEAR(std::stod(row[1]), sum / static_cast<double>(cells.size()), 0.00051) << row[0];
  }
  EXPECT_EQ(std::count_if(rows.begin(), rows.end(),
                          [](const Words& row) { return row.size() > 3 && row[2] == "pairs"; }),
            6);
}

TEST_F(LabExperiment, Table3HasTheCylinderAndNamesWhatIsMissing) {
  const auto rows = RowsOf(Run("table3"));
  int cylinders = 0, missing = 0;
  for (const Words& row : rows) {
    missing += row.size() > 3 && row.back() == "--data";
    if (row.empty() || row[0] != "cylinder") continue;
    ++cylinders;
    // Mean ms, published, p99 us, cm/s, felt %, through, stick.
    ASSERT_EQ(row.size(), 8u);
    EXPECT_GT(std::stod(row[1]), 0.0);
    EXPECT_GT(std::stod(row[3]), 0.0);
    EXPECT_GT(std::stod(row[5]), 30.0);
    EXPECT_EQ(row[6], "0");
    EXPECT_EQ(row[7], "0");
  }
  EXPECT_EQ(cylinders, 2);  // resolutions
  EXPECT_EQ(missing, 10);
}

TEST_F(LabExperiment, TopologyFindsFaultsInTheOthersAndNoneInOurs) {
  const std::string text = Run("topology");
  int kinds = 0;
  for (const Words& row : RowsOf(text)) {
    if (row.empty() || row[0] != "all") continue;
    ++kinds;
    // Cells, then for each method what is wrong and what is not filled.
    ASSERT_EQ(row.size(), 15u);
    EXPECT_EQ(row[1], "2000");
    EXPECT_GT(std::stod(row[3]), 0.5) << "bcc";
    EXPECT_GT(std::stod(row[9]), 0.5) << "tpbcc-published";
    EXPECT_EQ(row[12], "0.00");
    EXPECT_EQ(row[13], "0.00");
  }
  EXPECT_EQ(kinds, 2);
  EXPECT_EQ(Run("topology"), text);
}

TEST_F(LabExperiment, Figure9HasALineForEachLap) {
  const auto rows = RowsOf(Run("figure9"));
  const auto curves = MeasureDrift(options_.laps);
  for (int lap = 1; lap <= options_.laps; ++lap) {
    const Words row = RowOf(rows, std::to_string(lap));
    ASSERT_EQ(row.size(), 1 + curves.size());
    for (std::size_t c = 0; c < curves.size(); ++c) {
      EXPECT_NEAR(std::stod(row[c + 1]), curves[c].laps[lap - 1].isovalue, 1e-6);
    }
  }
  const std::string svg = test::TextOf(folder_.path() / "figure9.svg");
  EXPECT_EQ(CountOf(svg, "<polyline"), curves.size());
  EXPECT_TRUE(svg.ends_with("</svg>\n"));
}

TEST_F(LabExperiment, Figure11HasAPanelForEachCellAndMethod) {
  EXPECT_NE(Run("figure11").find("V and H by 4 methods for 29 cells"), std::string::npos);
  const std::string svg = test::TextOf(folder_.path() / "figure11.svg");
  EXPECT_EQ(CountOf(svg, "<g transform"), 29u * 5u);
  // The edges of the cell, and polygons of a surface, in each.
  EXPECT_GT(CountOf(svg, "<path"), 2u * 29u * 5u);
  EXPECT_TRUE(svg.ends_with("</svg>\n"));
}

TEST_F(LabExperiment, ErrorsAreClear) {
  EXPECT_THROW(Run("layers"), Error);  // no head in the folder
  EXPECT_THROW(Run("table5"), Error);
  options_.table = folder_.path() / "missing.csv";
  EXPECT_THROW(Run("table4"), Error);
  std::ofstream(folder_.path() / "bad.csv") << "1,0.5,0.1,0.2,x\n";
  options_.table = folder_.path() / "bad.csv";
  try {
    Run("table4");
    FAIL();
  } catch (const Error& error) {
    EXPECT_NE(std::string(error.what()).find("line 1"), std::string::npos) << error.what();
  }
}

}  // namespace
}  // namespace palpate::lab
