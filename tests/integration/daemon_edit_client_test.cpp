// `palpate edit`, `undo`, `redo`, `revert` and `save` against a real daemon.
#include <gtest/gtest.h>

#include <filesystem>
#include <fstream>
#include <nlohmann/json.hpp>

#include "tests/support/daemon.h"
#include "tests/support/places.h"

namespace palpate::test {
namespace {

class EditClientTest : public ::testing::Test {
 protected:
  void SetUp() override {
    daemon_ = std::make_unique<Daemon>(test::kPalpated,
                                       std::vector<std::string>{"--volume", "builtin:bumps:64"});
  }
  ProcessResult Run(std::vector<std::string> arguments) {
    arguments.insert(arguments.begin(), test::kPalpate);
    arguments.insert(arguments.end(), {"--socket", daemon_->socket()});
    return Process(arguments).Wait();
  }

  std::unique_ptr<Daemon> daemon_;
};

TEST_F(EditClientTest, EditsTakesBackAndSaves) {
  const auto json = [](const ProcessResult& result) {
    EXPECT_EQ(result.exit_code, 0) << result.error;
    return nlohmann::json::parse(result.output);
  };
  const auto edited = json(Run({"edit", "box", "--min-voxels", "10,10,10", "--max-voxels",
                                "12,12,12", "--operation", "set", "--value", "0.75", "--json"}));
  EXPECT_EQ(edited["changed_voxels"], 27);
  EXPECT_EQ(edited["changed"]["max"], nlohmann::json({12, 12, 12}));
  EXPECT_EQ(edited["volume_revision"], 2);
  const ProcessResult stroke =
      Run({"edit", "capsule", "--from-mm", "-1,2,3", "--to-mm", "9,2,3", "--radius-mm", "2",
           "--falloff-mm", "1", "--operation", "paint", "--value", "1", "--strength", ".5"});
  EXPECT_EQ(stroke.exit_code, 0) << stroke.error;
  EXPECT_NE(stroke.output.find("voxels changed within 0 0 1 to"), std::string::npos)
      << stroke.output;
  EXPECT_EQ(json(Run({"undo", "--json"}))["redo_steps"], 1);
  EXPECT_EQ(json(Run({"redo", "--json"}))["undo_steps"], 2);
  EXPECT_EQ(Run({"undo", "--expected-revision", "1"}).exit_code, 7);
  EXPECT_EQ(Run({"revert"}).exit_code, 0);

  const TemporaryFolder folder;
  const std::vector<float> values(8, 0.125f);
  const std::string raw = (folder.path() / "block.f32").string();
  std::ofstream(raw, std::ios::binary)
      .write(reinterpret_cast<const char*>(values.data()), sizeof(float) * 8);
  EXPECT_EQ(json(Run({"edit", "block", raw, "--min-voxels", "1,2,3", "--size-voxels", "2,2,2",
                      "--operation", "set", "--json"}))["changed"]["min"],
            nlohmann::json({1, 2, 3}));
  const std::string path = (folder.path() / "a.nrrd").string();
  const auto saved = json(Run({"save", path, "--json"}));
  EXPECT_EQ(saved["size_bytes"], std::filesystem::file_size(path));
  const ProcessResult there = Run({"save", path});
  EXPECT_EQ(there.exit_code, 7);
  EXPECT_EQ(Run({"save", path, "--overwrite"}).exit_code, 0);
}

TEST_F(EditClientTest, RefusesWhatMakesNoSense) {
  const std::vector<std::string> sphere = {"edit", "sphere", "--center-voxels", "9,9,9"};
  const auto with = [&](std::vector<std::string> more) {
    more.insert(more.begin(), sphere.begin(), sphere.end());
    return Run(more).exit_code;
  };
  EXPECT_EQ(with({"--radius-voxels", "2", "--operation", "set", "--value", "0.5"}), 0);
  EXPECT_EQ(with({"--radius-mm", "2", "--operation", "set", "--value", "0.5"}), 2);
  EXPECT_EQ(with({"--operation", "set", "--value", "0.5"}), 2);
  EXPECT_EQ(with({"--radius-voxels", "2", "--operation", "set"}), 2);
  EXPECT_EQ(with({"--radius-voxels", "2", "--value", "0.5"}), 2);
  EXPECT_EQ(with({"--radius-voxels", "2", "--operation", "cut", "--value", "0.5"}), 2);
  EXPECT_EQ(with({"--radius-voxels", "2", "--operation", "smooth", "--value", "0.5"}), 2);
  EXPECT_EQ(with({"--radius-voxels", "nan", "--operation", "smooth"}), 2);
  EXPECT_EQ(with({"--radius-voxels", "2", "--operation", "smooth", "--strength", "2"}), 2);
  EXPECT_EQ(with({"--radius-voxels", "-2", "--operation", "smooth"}), 3);
  EXPECT_EQ(Run({"edit"}).exit_code, 2);
  EXPECT_EQ(Run({"edit", "block", "/none", "--min-voxels", "1,1,1", "--size-voxels", "2,2,2",
                 "--operation", "set"})
                .exit_code,
            4);
  EXPECT_EQ(Run({"edit", "block", "/none", "--min-voxels", "-1,1,1", "--size-voxels", "2,2,2",
                 "--operation", "set"})
                .exit_code,
            2);
}

}  // namespace
}  // namespace palpate::test
