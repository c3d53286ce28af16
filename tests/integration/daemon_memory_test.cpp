// What a dense volume costs the daemon, and what its memory budget refuses.
#include <gtest/gtest.h>

#include <chrono>
#include <cstdint>
#include <cstdlib>
#include <fstream>
#include <sstream>
#include <thread>

#include "tests/support/daemon.h"
#include "tests/support/places.h"

namespace palpate::test {
namespace {

namespace fs = std::filesystem;

// A dense float tree of OpenVDB.
constexpr double kGridBytesPerVoxel = 4.22;

std::int64_t StatusKib(pid_t process, const std::string& key) {
  std::ifstream status("/proc/" + std::to_string(process) + "/status");
  for (std::string line; std::getline(status, line);) {
    if (line.starts_with(key + ":")) return std::stoll(line.substr(key.size() + 1));
  }
  ADD_FAILURE() << "no " << key;
  return 0;
}

// Floats without two that are equal in a row.
fs::path WriteNoise(const fs::path& path, int edge) {
  std::ofstream out(path, std::ios::binary);
  std::vector<float> row(static_cast<std::size_t>(edge) * edge);
  std::uint32_t state = 1;
  for (int k = 0; k < edge; ++k) {
    for (float& value : row) {
      state = state * 1664525u + 1013904223u;
      value = static_cast<float>(state >> 8);
    }
    out.write(reinterpret_cast<const char*>(row.data()),
              static_cast<std::streamsize>(row.size() * sizeof(float)));
  }
  return path;
}

class MemoryTest : public ::testing::Test {
 protected:
  void StartDaemon(const std::string& text, const std::string& volume = "builtin:sphere:16") {
    // Locked memory would count what is reserved, too.
    std::ofstream(folder_.path() / "palpated.toml") << "[realtime]\nlock_memory = false\n[volume]\n"
                                                    << text;
    daemon_ = std::make_unique<Daemon>(
        test::kPalpated,
        std::vector<std::string>{"--config", folder_.path() / "palpated.toml", "--volume", volume});
  }
  grpc::Status Load(const v1::LoadVolumeRequest& request) {
    grpc::ClientContext context;
    auto reader = daemon_->volume->LoadVolume(&context, request);
    for (v1::LoadVolumeResponse event; reader->Read(&event);) {
    }
    return reader->Finish();
  }
  grpc::Status Load(const std::string& source) {
    v1::LoadVolumeRequest request;
    request.set_source(source);
    return Load(request);
  }
  std::string Volume() {
    grpc::ClientContext context;
    v1::GetVolumeResponse response;
    EXPECT_TRUE(daemon_->volume->GetVolume(&context, {}, &response).ok());
    return response.SerializeAsString();
  }

  TemporaryFolder folder_;
  std::unique_ptr<Daemon> daemon_;
};

TEST_F(MemoryTest, ADenseVolumeCostsLittleMoreThanItsVoxels) {
  const int edge = std::getenv("PALPATE_TORTURE") ? 512 : 256;
  StartDaemon("");
  const pid_t process = daemon_->process().pid();
  const std::int64_t before_kib = StatusKib(process, "VmRSS");
  v1::LoadVolumeRequest request;
  request.set_source(WriteNoise(folder_.path() / "noise.raw", edge));
  request.mutable_raw()->set_type(v1::VOXEL_TYPE_FLOAT32);
  request.mutable_raw()->set_size_x(edge);
  request.mutable_raw()->set_size_y(edge);
  request.mutable_raw()->set_size_z(edge);
  const double grid_bytes = kGridBytesPerVoxel * edge * edge * edge;
  const auto bytes_per_grid_byte = [&](const std::string& key) {
    return 1024.0 * static_cast<double>(StatusKib(process, key) - before_kib) / grid_bytes;
  };
  // The second one frees the first.
  for (int round = 0; round < 2; ++round) {
    const grpc::Status status = Load(request);
    ASSERT_TRUE(status.ok()) << status.error_message();
    std::printf("%d^3 floats: %.3f of the grid's 4.22 B/voxel, %.3f at the peak\n", edge,
                bytes_per_grid_byte("VmRSS"), bytes_per_grid_byte("VmHWM"));
#ifndef PALPATE_SANITIZED  // which keeps what was freed for a while
    // The volume before is freed on a thread that the load does not wait for.
    const auto end = std::chrono::steady_clock::now() + std::chrono::seconds(30);
    while (bytes_per_grid_byte("VmRSS") > 1.3 && std::chrono::steady_clock::now() < end) {
      std::this_thread::sleep_for(std::chrono::milliseconds(20));
    }
    EXPECT_LE(bytes_per_grid_byte("VmRSS"), 1.3);
#endif
  }
}

TEST_F(MemoryTest, TooMuchIsRefusedInAdvanceAndTheVolumeStays) {
  StartDaemon("memory_budget_mib = 20\n", "builtin:sphere:64");
  const std::string before = Volume();
  v1::LoadVolumeRequest raw;
  // Sparse: its size alone is known.
  raw.set_source((folder_.path() / "sparse.raw").string());
  std::ofstream(folder_.path() / "sparse.raw");
  fs::resize_file(folder_.path() / "sparse.raw", std::uintmax_t{1024} * 1024 * 1024);
  raw.mutable_raw()->set_type(v1::VOXEL_TYPE_UINT8);
  raw.mutable_raw()->set_size_x(1024);
  raw.mutable_raw()->set_size_y(1024);
  raw.mutable_raw()->set_size_z(1024);
  for (const grpc::Status& status : {Load(raw), Load("builtin:bumps:512")}) {
    EXPECT_EQ(status.error_code(), grpc::StatusCode::RESOURCE_EXHAUSTED) << status.error_message();
    for (const char* part :
         {"needs", "budget of 20 MiB", "(the volume ", "volume.memory_budget_mib"}) {
      EXPECT_NE(status.error_message().find(part), std::string::npos) << status.error_message();
    }
  }
  EXPECT_EQ(Volume(), before);
  // What fits goes in, again and again.
  for (int round = 0; round < 4; ++round) {
    const grpc::Status status = Load("builtin:bumps:100");
    EXPECT_TRUE(status.ok()) << status.error_message();
  }
}

}  // namespace
}  // namespace palpate::test
