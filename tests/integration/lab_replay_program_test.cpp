// palpate-lab trajectory and replay as users run them: what is written, that it holds against the
// program's own cells, and what is refused.
#include <gtest/gtest.h>

#include <cmath>
#include <filesystem>
#include <fstream>
#include <nlohmann/json.hpp>
#include <sstream>

#include "common/error/error.h"
#include "server/lab/lab_arguments.h"
#include "tests/support/places.h"
#include "tests/support/process.h"
#include "tests/support/temporary_folder.h"

namespace palpate::lab {
namespace {

using Json = nlohmann::json;
using test::Process;
using test::ProcessResult;

constexpr std::chrono::seconds kPatience{60};
constexpr int kReplayTicks = 1500;
constexpr const char* kVolume = "builtin:bumps:64";
constexpr const char* kIsovalue = "0.4";

ProcessResult Lab(const std::vector<std::string>& arguments) {
  std::vector<std::string> command = {test::kPalpateLab};
  command.insert(command.end(), arguments.begin(), arguments.end());
  return Process(command, kPatience).Wait();
}

// Rows as numbers, without the header.
std::vector<std::vector<double>> ReadReplay(const std::filesystem::path& path) {
  std::ifstream in(path);
  std::vector<std::vector<double>> rows;
  std::string line;
  std::getline(in, line);
  while (std::getline(in, line)) {
    rows.emplace_back();
    std::istringstream fields(line);
    for (std::string field; std::getline(fields, field, ',');) {
      rows.back().push_back(std::strtod(field.c_str(), nullptr));
    }
  }
  return rows;
}

class LabReplayProgram : public ::testing::Test {
 protected:
  ProcessResult Replay(const std::filesystem::path& trajectory, const std::filesystem::path& out,
                       const std::vector<std::string>& more = {}) {
    std::vector<std::string> arguments = {"replay",     "--volume", kVolume,
                                          "--isovalue", kIsovalue,  "--trajectory",
                                          trajectory,   "--out",    out};
    arguments.insert(arguments.end(), more.begin(), more.end());
    return Lab(arguments);
  }

  test::TemporaryFolder folder_;
  const std::filesystem::path trajectory_ = folder_.path() / "t.csv";
  const std::filesystem::path out_ = folder_.path() / "o.csv";
};

// Density at a point of a decomposed cell as `cells` writes it: in the tetrahedron
// that the point is deepest in.
double DensityIn(const Json& cell, const Vec3& local) {
  double deepest = -1e300, density = 0.0;
  for (const Json& tetrahedron : cell["tetrahedra"]) {
    Eigen::Matrix4d corners;
    Eigen::RowVector4d densities;
    for (int n = 0; n < 4; ++n) {
      const Json& vertex = cell["vertices"][tetrahedron[n].get<std::size_t>()];
      for (int axis = 0; axis < 3; ++axis) corners(axis, n) = vertex[axis];
      corners(3, n) = 1.0;
      densities[n] = vertex[3];
    }
    const Eigen::Vector4d weights = corners.inverse() * local.homogeneous();
    if (weights.minCoeff() <= deepest) continue;
    deepest = weights.minCoeff();
    density = densities * weights;
  }
  EXPECT_GT(deepest, -1e-9);
  return density;
}

TEST_F(LabReplayProgram, JudgesTheSlideAndHasTheDensityOfItsOwnCells) {
  const ProcessResult made =
      Lab({"trajectory", "--volume", kVolume, "--isovalue", kIsovalue, "--speed-cm-per-s", "20",
           "--ticks", std::to_string(kReplayTicks), "--out", trajectory_});
  ASSERT_EQ(made.exit_code, 0) << made.error;
  const ProcessResult replay = Replay(trajectory_, out_);
  ASSERT_EQ(replay.exit_code, 0) << replay.error;
  const Json json = Json::parse(replay.output);
  EXPECT_EQ(json["ticks"], kReplayTicks);
  EXPECT_GT(json["contact_ticks"], kReplayTicks / 2);
  for (const char* key : {"fall_throughs", "sticks", "iteration_cap_hits", "rejected_ticks",
                          "unchecked_ticks", "ejecting_ticks", "excess_off_minimum_ticks"}) {
    EXPECT_EQ(json[key], 0) << key;
  }
  for (const char* key : {"excess_force_ticks", "mean_ns", "p50_ns", "p99_ns", "max_ns"}) {
    EXPECT_TRUE(json[key].is_number()) << key;
  }
  // Friction holds the proxy on purpose.
  const ProcessResult rubbed =
      Replay(trajectory_, out_, {"--overwrite", "--set", "dynamic_friction=0.3"});
  EXPECT_TRUE(Json::parse(rubbed.output)["sticks"].is_null());
  // Whole cells are what `cells` tells of.
  ASSERT_EQ(Replay(trajectory_, out_, {"--overwrite", "--refine", "1"}).exit_code, 0);
  const auto volume = LoadVolume(
      kVolume, std::filesystem::path(test::kPalpateLab).parent_path() / "palpate-import");
  const double isovalue = std::stod(kIsovalue);
  const AffineMap X_IW = volume->metadata().WorldFromIndex().Inverse();
  // A cell a tick, in order.
  std::ofstream input(folder_.path() / "cells.csv");
  std::vector<Vec3> locals;
  const auto rows = ReadReplay(out_);
  ASSERT_EQ(rows.size(), static_cast<std::size_t>(kReplayTicks));
  for (const auto& row : rows) {
    const Vec3 p_I = X_IW.Apply(Vec3(row[4], row[5], row[6]));
    const Vec3 cell = p_I.array().floor();
    locals.push_back(p_I - cell);
    input << cell.x() << "," << cell.y() << "," << cell.z() << "\n";
  }
  input.close();
  const std::string command =
      std::string(test::kPalpateLab) + " cells --volume " + std::string(kVolume) + " < " +
      (folder_.path() / "cells.csv").string() + " > " + (folder_.path() / "cells.json").string();
  ASSERT_EQ(Process({"/bin/sh", "-c", command}, kPatience).Wait().exit_code, 0);
  std::ifstream cells(folder_.path() / "cells.json");
  int on_surface = 0;
  for (std::size_t n = 0; n < rows.size(); ++n) {
    std::string line;
    ASSERT_TRUE(std::getline(cells, line));
    const double density = volume->Denormalize(DensityIn(Json::parse(line), locals[n]));
    ASSERT_NEAR(rows[n][15], density, 1e-9) << "tick " << n;
    ASSERT_LE(density, isovalue + 1e-9) << "tick " << n;
    on_surface += rows[n][11] == 1.0 && std::abs(density - isovalue) < 1e-6;
  }
  EXPECT_GT(on_surface, kReplayTicks / 2);
}

// What is refused: lab_replay_test. Here, that it has its code and leaves nothing.
TEST_F(LabReplayProgram, RefusesAndWritesNothing) {
  std::ofstream(trajectory_) << "x_mm,y_mm,z_mm\n1,2,3\n";
  const auto refuses = [&](const std::filesystem::path& trajectory, int exit_code,
                           const std::vector<std::string>& more = {}) {
    const ProcessResult refused = Replay(trajectory, out_, more);
    EXPECT_EQ(refused.exit_code, exit_code) << refused.error;
    EXPECT_TRUE(refused.output.empty()) << refused.output;
  };
  refuses(folder_.path() / "none.csv", ExitCode(ErrorKind::kNotFound));
  const int invalid = ExitCode(ErrorKind::kInvalidArgument);
  for (const char* more : {"--set=colour=red", "--stiffness=-1", "--spacing-mm=-1"}) {
    refuses(trajectory_, invalid, {more});
  }
  for (const char* more : {"--method=marching", "--passes=0"}) {
    refuses(trajectory_, kUsageExitCode, {more});
  }
  EXPECT_EQ(Replay(trajectory_, "/dev/full").exit_code, invalid);
  EXPECT_FALSE(std::filesystem::exists(out_));
  EXPECT_FALSE(std::filesystem::exists(out_.string() + ".partial"));
}

// Every command that writes a file but `export`: python_tables_test.py.
TEST_F(LabReplayProgram, ReplacesAFileOnlyWhenToldTo) {
  std::ofstream(trajectory_) << "x_mm,y_mm,z_mm\n1,2,3\n";
  const std::string figure = folder_.path() / "figure9.svg", mesh = folder_.path() / "m.ply";
  const std::pair<std::string, std::vector<std::string>> writers[] = {
      {mesh, {"mesh", "--volume", kVolume, "--isovalue", kIsovalue, "--out", mesh}},
      {out_,
       {"trajectory", "--volume", kVolume, "--isovalue", kIsovalue, "--ticks", "9", "--out", out_}},
      {out_,
       {"replay", "--volume", kVolume, "--isovalue", kIsovalue, "--trajectory", trajectory_,
        "--out", out_}},
      {figure, {"experiment", "figure9", "--out", folder_.path()}}};
  for (auto [file, command] : writers) {
    SCOPED_TRACE(command.front());
    std::ofstream(file) << "precious";
    EXPECT_EQ(Lab(command).exit_code, ExitCode(ErrorKind::kConflict));
    EXPECT_EQ(test::TextOf(file), "precious");
    command.emplace_back("--overwrite");
    const ProcessResult told = Lab(command);
    EXPECT_EQ(told.exit_code, 0) << told.error;
    EXPECT_NE(test::TextOf(file), "precious");
  }
}

}  // namespace
}  // namespace palpate::lab
