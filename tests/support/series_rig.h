// A time series of five small frames under a running servo loop, without gRPC.
#pragma once

#include <gtest/gtest.h>

#include <algorithm>
#include <chrono>
#include <filesystem>
#include <functional>
#include <memory>
#include <string>
#include <thread>
#include <vector>

#include "server/device/path_script.h"
#include "server/device/simulated_device.h"
#include "server/servo/servo_loop.h"
#include "server/session/series_player.h"
#include "server/volume/brick_memory.h"
#include "tests/support/fake_importer.h"
#include "tests/support/temporary_folder.h"

namespace palpate::testing {

inline const LoadProgress kQuiet = [](std::string_view, double) {};
inline const LoadCancelled kNever = [] { return false; };
// Bricks are cut off at every side.
inline const Vec3i kSize(20, 17, 9);
inline constexpr int kFrames = 5;
inline constexpr std::uint64_t kBudgetBytes = std::uint64_t{64} << 20;

// A growing ball in a constant slab. The least and the greatest value come in different frames.
inline float ValueAt(int frame, int i, int j, int k) {
  if (i >= 16) return 3.0f;
  if (frame == 2 && i == 1 && j == 1 && k == 1) return -7.5f;
  if (frame == 3 && i == 1 && j == 1 && k == 1) return 60.0f;
  const double r = Vec3(i - 8, j - 8, k - 4).norm();
  return static_cast<float>(std::max(0.0, 10.0 + frame - r));
}

class SeriesPlayerTest : public ::testing::Test {
 protected:
  void SetUp() override {
    for (int frame = 0; frame < kFrames; ++frame) {
      const auto value = [&](int i, int j, int k) { return ValueAt(frame, i, j, k); };
      files_.push_back(folder_.path() / ("t" + std::to_string(frame) + ".vdb"));
      testing::WriteFakeVolume(files_.back(), kSize, value);
      testing::WriteFakeVolume(folder_.path() / ("all.vdb." + std::to_string(frame)), kSize, value,
                               kFrames);
    }
    device_ = std::make_unique<SimulatedDevice>(
        std::make_unique<PathScript>(std::vector<Vec3>{Vec3(-70, 2, 1), Vec3(70, 1, 2)}, 100.0));
    outbox_ = std::make_unique<TickOutbox>();
    pump_ = std::make_unique<Pump>(*outbox_);
    budget_ = MemoryBudget::Make(kBudgetBytes, LiveBrickBytes);
    session_ = std::make_unique<Session>(
        device_->spec(), inbox_, *pump_,
        VolumeLoader{.import_program = testing::WriteFakeImporter(folder_.path()),
                     .budget = budget_});
    if (listener_) listening_.emplace(*session_, *listener_);
    session_->Load({.source = "builtin:sphere:16"}, kQuiet, kNever);
    RealtimeOptions options;
    options.lock_memory = false;
    servo_ = std::make_unique<ServoLoop>(*device_, inbox_, *outbox_, options, SafetyLimits{});
    pump_->Start();
    servo_->Start();
    player_ = std::make_unique<SeriesPlayer>(*session_);
  }
  void TearDown() override {
    player_.reset();
    servo_->Stop();
    pump_->Stop();
  }

  VolumeState Load(const LoadRequest& request = {}) {
    return player_->Load(files_, request, kQuiet, kNever);
  }
  ContentHash Hash() const { return session_->volume().volume->bricks().content_hash(); }
  std::uint64_t Revision() const { return session_->volume().volume->revision(); }

  // Voxels by a formula, with the least value of the whole series beyond them.
  static BrickDirectory Directory(const std::function<float(int, int, int)>& value) {
    return {kSize, [&](const Vec3i& brick) {
              Brick values{};
              for (int n = 0; n < kBrickVoxels; ++n) {
                const Vec3i v = brick * 8 + Vec3i(n >> 6, n >> 3 & 7, n & 7);
                values[n] = (v.array() < kSize.array()).all() ? value(v.x(), v.y(), v.z()) : -7.5f;
              }
              return Leaf::Of(LeafType::kFloat, values);
            }};
  }
  static ContentHash FrameHash(int frame) {
    return Directory([&](int i, int j, int k) { return ValueAt(frame, i, j, k); }).content_hash();
  }
  // Returns false if the condition does not hold within two seconds.
  static bool Soon(const std::function<bool()>& condition) {
    const auto end = std::chrono::steady_clock::now() + std::chrono::seconds(2);
    while (!condition()) {
      if (std::chrono::steady_clock::now() > end) return false;
      std::this_thread::sleep_for(std::chrono::milliseconds(2));
    }
    return true;
  }
  bool Shows(int frame) {
    return Soon([&] { return Hash() == FrameHash(frame); });
  }
  // Returns the memory held after everything unused is freed.
  std::uint64_t HeldSoon() {
    session_->retired().WaitForFreed(std::chrono::seconds(10));
    return budget_->held_bytes();
  }
  // Paints a voxel, as an editor does.
  void Paint(const Vec3i& voxel, float value) {
    session_->store().Edit([&](const auto& present) {
      const Vec3i brick = voxel / 8;
      Brick values = present->bricks().At(brick)->Floats();
      values[VoxelInBrick(voxel.x(), voxel.y(), voxel.z())] = value;
      return std::vector<BrickChange>{{brick, Leaf::Of(LeafType::kFloat, values)}};
    });
  }
  float At(const Vec3i& v) const {
    const VolumeState state = session_->volume();
    return state.volume->bricks().Find(v.x(), v.y(), v.z())[VoxelInBrick(v.x(), v.y(), v.z())];
  }

  SceneListener* listener_ = nullptr;
  test::TemporaryFolder folder_;
  std::vector<std::filesystem::path> files_;
  SceneInbox inbox_;
  std::unique_ptr<SimulatedDevice> device_;
  std::unique_ptr<TickOutbox> outbox_;
  std::unique_ptr<Pump> pump_;
  std::shared_ptr<MemoryBudget> budget_;
  std::unique_ptr<Session> session_;
  std::optional<Listening> listening_;
  std::unique_ptr<ServoLoop> servo_;
  std::unique_ptr<SeriesPlayer> player_;
};

}  // namespace palpate::testing
