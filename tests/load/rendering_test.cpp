// The main job: a real daemon renders volumes at 1 kHz, and a change is felt at once.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <numeric>
#include <thread>
#include <utility>

#include "prometheus/registry.h"
#include "server/metrics/state_metrics.h"
#include "tests/load/servo_figures.h"
#include "tests/support/bare_loops.h"
#include "tests/support/daemon.h"
#include "tests/support/data_folder.h"
#include "tests/support/places.h"
#include "tests/support/stolen.h"

namespace palpate::load {
namespace {

using std::chrono::milliseconds;
using test::Daemon;
using test::Eventually;
using test::PoseCollector;

// One of 200 of its ticks is 20: a machine that stops for a few milliseconds does not make them.
constexpr int kWatchedMs = 4000;

const std::string kHead =
    testing::DataFolder() / "paper/SUBST_head_ct_cranium_256x256x108_int16.nrrd";
// Normalised.
constexpr double kBone = 0.33;

// Also what must never be met, whatever the machine does.
struct Felt {
  std::size_t contacts = 0, visual = 0, inside = 0, jumps = 0, ejecting = 0, faults = 0;
  std::vector<double> update_us;
};

Felt Summarize(const std::vector<v1::PoseSample>& samples) {
  Felt felt;
  const v1::PoseSample* last = nullptr;
  for (const v1::PoseSample& s : samples) {
    felt.contacts += s.contact();
    felt.visual += s.has_scp_v_mm();
    felt.ejecting += s.mode() == v1::PROXY_MODE_EJECTING;
    felt.faults += s.mode() == v1::PROXY_MODE_FAULT;
    felt.inside += s.density() > s.isovalue();
    felt.update_us.push_back(static_cast<double>(s.update_ns()) * 1e-3);
    if (last && s.tick() == last->tick() + 1) {
      const v1::Vector3 &a = s.force_n(), &b = last->force_n();
      felt.jumps += std::hypot(a.x() - b.x(), a.y() - b.y(), a.z() - b.z()) > 0.2 + 1e-9;
    }
    last = &s;
  }
  return felt;
}

// Until the hand has felt the surface.
bool WaitForContact(Daemon& daemon) {
  return Eventually([&] {
    PoseCollector collector(daemon);
    if (!daemon.WaitForTicks(100)) return false;
    const auto& samples = collector.Stop();
    return std::any_of(samples.begin(), samples.end(), [](const auto& s) { return s.contact(); });
  });
}

class RenderingTest : public ::testing::Test {
 protected:
  // Returns false where there is no such volume.
  bool Start(const std::string& source, double isovalue) {
    if (!source.starts_with("builtin:") && !std::filesystem::exists(source)) return false;
    daemon_ = std::make_unique<Daemon>(
        test::kPalpated, std::vector<std::string>{"--volume", source, "--normalized-isovalue",
                                                  std::to_string(isovalue)});
    EXPECT_TRUE(WaitForContact(*daemon_));
    return true;
  }
  void JudgeAtOneKilohertz(double most_mean_us, bool has_tool = false);

  double mean_update_us_ = 0.0;  // as judged last
  const test::StolenShare steal_;
  std::unique_ptr<Daemon> daemon_;
};

void RenderingTest::JudgeAtOneKilohertz(double most_mean_us, bool has_tool) {
  PoseCollector collector(*daemon_);
  test::BareLoops bare_loops;
  std::this_thread::sleep_for(milliseconds(kWatchedMs));
  bare_loops.Stop();
  const auto& samples = collector.Stop();
  ASSERT_GT(samples.size(), static_cast<std::size_t>(kWatchedMs / 2));
  const Felt felt = Summarize(samples);
  const auto& [first, last] = std::pair(samples.front(), samples.back());
  // Ticks and missed ticks count milliseconds.
  const auto missed = static_cast<double>(last.missed_ticks() - first.missed_ticks());
  const double loop_ms = static_cast<double>(last.tick() - first.tick()) + missed;
  const double wall_ms = static_cast<double>(last.time_ns() - first.time_ns()) * 1e-6;
  EXPECT_NEAR(loop_ms, wall_ms, 0.001 * wall_ms + 1.0);
  // What the machine takes, stopping for milliseconds, it takes from loops without work, too.
  const auto bare_missed = static_cast<double>(bare_loops.most());
  mean_update_us_ = std::accumulate(felt.update_us.begin(), felt.update_us.end(), 0.0) /
                    static_cast<double>(felt.update_us.size());
  std::printf(
      "%zu samples, %zu in contact; %.0f ticks missed, bare loops %.0f; update mean %.2f us,"
      " p99 %.2f us\n",
      samples.size(), felt.contacts, missed, bare_missed, mean_update_us_,
      Percentile(felt.update_us, 0.99));
  v1::GetDeviceResponse device;
  grpc::ClientContext context;
  ASSERT_TRUE(daemon_->device->GetDevice(&context, {}, &device).ok());
  if (device.servo().realtime_scheduling()) {
    EXPECT_LE(missed, 0.005 * loop_ms + bare_missed);
  }
  EXPECT_LT(mean_update_us_, most_mean_us);
  EXPECT_EQ(felt.inside + felt.ejecting + felt.jumps + felt.faults, 0u);
  EXPECT_EQ(samples.back().has_tool_orientation(), has_tool);
  if (has_tool) return;
  EXPECT_GT(felt.contacts, samples.size() * 4 / 10);
  EXPECT_GE(felt.visual, felt.contacts * 99 / 100);
}

TEST_F(RenderingTest, AtOneKilohertz) {
  ASSERT_TRUE(Start("builtin:bumps", 0.5));
  JudgeAtOneKilohertz(20.0);
}

TEST_F(RenderingTest, AHeadAtOneKilohertz) {
  if (!Start(kHead, kBone)) GTEST_SKIP() << kHead << " is not there";
  JudgeAtOneKilohertz(20.0);
}

// A burr on a shaft of 63 balls costs less than 64 points, and no tick.
TEST_F(RenderingTest, AHeadWithAToolAtOneKilohertz) {
  if (!Start(kHead, kBone)) GTEST_SKIP() << kHead << " is not there";
  JudgeAtOneKilohertz(20.0);
  v1::UpdateSettingsRequest request;
  for (int n = 0; n < 64; ++n) {
    v1::HeldToolBall& ball = *request.mutable_settings()->mutable_tool()->add_ball();
    ball.mutable_center_mm()->set_z(n == 0 ? 0.0 : 3.0 + 0.9 * n);
    ball.set_radius_mm(n == 0 ? 3.0 : 1.5);
  }
  request.mutable_update_mask()->add_paths("tool");
  grpc::ClientContext context;
  v1::UpdateSettingsResponse response;
  ASSERT_TRUE(daemon_->render->UpdateSettings(&context, request, &response).ok());
  ASSERT_TRUE(Eventually([&] {
    PoseCollector collector(*daemon_);
    if (!daemon_->WaitForTicks(100)) return false;
    const auto& samples = collector.Stop();
    return std::ranges::any_of(samples, &v1::PoseSample::touching_balls);
  }));
  JudgeAtOneKilohertz(64.0 * mean_update_us_, true);
}

// That it is felt from the tick that the answer names: python_settings_test.
TEST_F(RenderingTest, AnIsovalueIsAppliedWithinMilliseconds) {
  constexpr int kChanges = 300;
  ASSERT_TRUE(Start("builtin:bumps:64", 0.5));
  std::vector<double> latency_ms;
  for (int n = 0; n < kChanges; ++n) {
    v1::UpdateSettingsRequest request;
    request.mutable_settings()->set_normalized_isovalue(0.5 + 0.1 * std::sin(n * 0.7));
    request.mutable_update_mask()->add_paths("normalized_isovalue");
    grpc::ClientContext context;
    v1::UpdateSettingsResponse response;
    ASSERT_TRUE(daemon_->render->UpdateSettings(&context, request, &response).ok());
    latency_ms.push_back(static_cast<double>(response.receipt_to_applied_ns()) * 1e-6);
    std::this_thread::sleep_for(milliseconds(7));
  }
  std::printf("receipt to tick: p50 %.2f ms, p99 %.2f ms\n", Percentile(latency_ms, 0.5),
              Percentile(latency_ms, 0.99));
  EXPECT_LE(Percentile(latency_ms, 0.99), 5.0);
}

// The pump has a millisecond for each.
TEST(MetricsCost, ASampleIsCountedInLittleTime) {
  constexpr int kSamples = 100'000;
  const test::StolenShare steal;
  prometheus::Registry registry;
  ServoMetrics metrics(registry);
  TickSample sample;
  const auto begin = std::chrono::steady_clock::now();
  for (int n = 0; n < kSamples; ++n) {
    ++sample.tick;
    sample.time_ns += 1'000'000;
    metrics.OnSample(sample);
  }
  const std::chrono::duration<double, std::nano> took = std::chrono::steady_clock::now() - begin;
  std::printf("%.0f ns per sample\n", took.count() / kSamples);
  // Some 300 ns.
  EXPECT_LT(took.count() / kSamples, 20'000);
}

}  // namespace
}  // namespace palpate::load
