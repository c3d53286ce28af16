// A client that asks for more poses than there are to give: what it is refused, and what
// everybody else gets meanwhile.
#include <gtest/gtest.h>

#include <memory>
#include <string>
#include <vector>

#include "server/realtime/tick_timer.h"
#include "tests/load/servo_figures.h"
#include "tests/load/subscriber.h"
#include "tests/support/daemon.h"
#include "tests/support/excuse.h"
#include "tests/support/free_port.h"
#include "tests/support/patience.h"
#include "tests/support/places.h"

namespace palpate::test {
namespace {

using load::Percentile;
using load::Subscriber;
using load::SubscriberKind;

constexpr int kCrowd = 256;
// Every tick a message of its own: the dearest stream that there is.
constexpr SubscriberKind kGreedy{"greedy", 1000.0, 1, 64};
constexpr SubscriberKind kViewer{"60 Hz", 60.0, 1, 16};
constexpr double kViewerHz = 1000.0 / 17.0;
constexpr int kRounds = 60;

class Crowd : public ::testing::Test {
 protected:
  std::string tcp() const { return "127.0.0.1:" + std::to_string(port_); }
  std::string socket() const { return "unix:" + daemon_.socket().string(); }

  // Asks for all streams and waits until each has been answered.
  void Come(const std::string& target) {
    for (int n = 0; n < kCrowd; ++n) {
      crowd_.push_back(std::make_unique<Subscriber>(target, kGreedy));
    }
    for (const auto& one : crowd_) {
      ASSERT_TRUE(Eventually([&] { return one->has_ended() || one->received_so_far() > 0; }));
    }
  }
  // So many of them were refused, each in one line of what to do.
  void Go(int refused) {
    int refusals = 0;
    for (const auto& one : crowd_) {
      const bool was_refused = one->has_ended();
      one->Stop();
      if (!was_refused) continue;
      ++refusals;
      for (const char* part : {"palpated refuses StreamPoses: ", "ask for a lower rate",
                               "end other streams", "limits.pose_samples_per_s"}) {
        EXPECT_NE(one->error().find(part), std::string::npos) << one->error();
      }
    }
    EXPECT_EQ(refusals, refused);
    crowd_.clear();
  }

  template <typename Call>
  void Expect(const char* name, const Call& call) {
    grpc::ClientContext context;
    context.set_deadline(std::chrono::system_clock::now() + std::chrono::seconds(10));
    const std::int64_t began_ns = MonotonicNowNs();
    const grpc::Status status = call(context);
    waits_ms_.push_back(static_cast<double>(MonotonicNowNs() - began_ns) * 1e-6);
    EXPECT_TRUE(status.ok()) << name << ": " << status.error_message();
  }
  // What waits for a tick, again and again.
  void CallAll() {
    for (int n = 0; n < kRounds; ++n) {
      Expect("StopForces", [&](grpc::ClientContext& context) {
        v1::StopForcesResponse response;
        return daemon_.device->StopForces(&context, {}, &response);
      });
      Expect("EnableForces", [&](grpc::ClientContext& context) {
        v1::EnableForcesResponse response;
        return daemon_.device->EnableForces(&context, {}, &response);
      });
      Expect("UpdateSettings", [&](grpc::ClientContext& context) {
        v1::UpdateSettingsRequest request;
        request.mutable_settings()->set_stiffness_n_per_mm(0.4 + 0.001 * n);
        request.mutable_update_mask()->add_paths("stiffness_n_per_mm");
        v1::UpdateSettingsResponse response;
        return daemon_.render->UpdateSettings(&context, request, &response);
      });
    }
  }
  v1::ServoDescription Servo() {
    grpc::ClientContext context;
    v1::GetDeviceResponse response;
    EXPECT_TRUE(daemon_.device->GetDevice(&context, {}, &response).ok());
    return response.servo();
  }
  static bool Works(const std::string& target, const SubscriberKind& kind) {
    Subscriber one(target, kind);
    const bool works = Eventually([&] { return one.has_ended() || one.received_so_far() > 30; });
    return works && !one.has_ended();
  }

  void CheckViewer(Subscriber& viewer, std::int64_t from_ns, std::int64_t to_ns);
  void Attack(const std::string& target, int refused);

  const int port_ = FreePort();
  Daemon daemon_{test::kPalpated, {"--volume", "builtin:sphere:32", "--listen", tcp()}};
  std::vector<std::unique_ptr<Subscriber>> crowd_;
  std::vector<double> waits_ms_;
};

void Crowd::CheckViewer(Subscriber& viewer, std::int64_t from_ns, std::int64_t to_ns) {
  EXPECT_FALSE(viewer.has_ended());
  viewer.Stop();
  std::vector<double> ages_ms;
  int received = 0;
  for (std::size_t n = 0; n < viewer.received().size(); ++n) {
    const std::int64_t time_ns = viewer.received()[n].time_ns;
    if (time_ns < from_ns || time_ns >= to_ns) continue;
    ++received;
    ages_ms.push_back(static_cast<double>(viewer.ages_ns()[n]) * 1e-6);
  }
  const double expected = static_cast<double>(to_ns - from_ns) * 1e-9 * kViewerHz;
  std::printf("viewer %d of %.0f samples, age p50 %.2f ms, p99 %.2f ms\n", received, expected,
              Percentile(ages_ms, 0.5), Percentile(ages_ms, 0.99));
  EXPECT_GT(received, 0);
#ifndef PALPATE_SANITIZED
  // The crowd is on this machine too.
  EXPECT_GE(received, 0.8 * expected) << kBusyMachine;
  EXPECT_LT(Percentile(ages_ms, 0.99), 100.0) << kBusyMachine;
#endif
}

// With an honest viewer who was there before, and others who come.
void Crowd::Attack(const std::string& target, int refused) {
  Subscriber viewer(socket(), kViewer);
  ASSERT_TRUE(Eventually([&] { return viewer.received_so_far() > 0; }));
  ASSERT_NO_FATAL_FAILURE(Come(target));
  const std::int64_t from_ns = MonotonicNowNs();
  const v1::ServoDescription before = Servo();
  CallAll();
  ASSERT_TRUE(Eventually([&] { return MonotonicNowNs() - from_ns > 3'000'000'000; }));
  const std::int64_t to_ns = MonotonicNowNs();
  const v1::ServoDescription after = Servo();
  if (target != socket()) {
    EXPECT_TRUE(Works(socket(), kViewer));
  }
  std::printf(
      "%s: %d of %d refused, %lu ticks, %lu missed, %lu samples lost; answers p50 %.1f ms, "
      "p99 %.1f ms\n",
      target.c_str(), refused, kCrowd, static_cast<unsigned long>(after.ticks() - before.ticks()),
      static_cast<unsigned long>(after.missed_ticks() - before.missed_ticks()),
      static_cast<unsigned long>(after.lost_samples() - before.lost_samples()),
      Percentile(waits_ms_, 0.5), Percentile(waits_ms_, 0.99));
#ifndef PALPATE_SANITIZED
  EXPECT_EQ(after.lost_samples(), before.lost_samples()) << kBusyMachine;
#endif
  EXPECT_LT(Percentile(waits_ms_, 0.9), 1000.0) << kBusyMachine;
  CheckViewer(viewer, from_ns, to_ns);
  Go(refused);
  // What they had is there again.
  EXPECT_TRUE(Eventually([&] { return Works(target, kGreedy); }));
}

TEST_F(Crowd, OverTheNetworkHasHalfOfTheSamplesAndHindersNobody) { Attack(tcp(), kCrowd - 16); }

// One of 32 full streams makes room for the viewer who was there before.
TEST_F(Crowd, OnTheSocketHasAllThatIsLeftAndHindersNobodyWhoIsThere) {
  Attack(socket(), kCrowd - 31);
}

}  // namespace
}  // namespace palpate::test
