// What the metrics make of the servo's samples. What that costs: tests/load/rendering_test.cpp.
#include "server/metrics/state_metrics.h"

#include <gtest/gtest.h>
#include <prometheus/registry.h>
#include <prometheus/text_serializer.h>

#include <map>
#include <sstream>
#include <string>

namespace palpate {
namespace {

class ServoMetricsTest : public ::testing::Test {
 protected:
  // By name, with labels, as in the text format.
  std::map<std::string, double> Values() const {
    std::ostringstream text;
    prometheus::TextSerializer().Serialize(text, registry_.Collect());
    std::istringstream lines(text.str());
    std::map<std::string, double> values;
    for (std::string line; std::getline(lines, line);) {
      if (line.starts_with('#')) continue;
      const std::size_t space = line.rfind(' ');
      values[line.substr(0, space)] = std::stod(line.substr(space + 1));
    }
    return values;
  }

  // A tick in free space, a millisecond after the one before.
  TickSample Next() {
    TickSample sample;
    sample.tick = tick_++;
    sample.time_ns = 1'000'000'000 + static_cast<std::int64_t>(sample.tick) * 1'000'000;
    sample.update_ns = 4'000;
    sample.isovalue = 100.0;
    sample.density = 50.0;
    sample.force_limit_n = 3.3;
    return sample;
  }

  prometheus::Registry registry_;
  ServoMetrics metrics_{registry_};
  std::uint64_t tick_ = 1;
};

TEST_F(ServoMetricsTest, RunningTotalsAreNotCountedTwice) {
  for (std::uint64_t n = 0; n < 10; ++n) {
    TickSample sample = Next();
    sample.missed_ticks = 2 * n;
    sample.faulty_ticks = n / 2;
    sample.capped_ticks = 3;
    metrics_.OnSample(sample);
  }
  const auto values = Values();
  EXPECT_EQ(values.at("palpate_ticks_total"), 10);
  EXPECT_EQ(values.at("palpate_missed_ticks_total"), 18);
  EXPECT_EQ(values.at("palpate_faulty_ticks_total"), 4);
  EXPECT_EQ(values.at("palpate_capped_ticks_total"), 3);
}

TEST_F(ServoMetricsTest, AProxyInTheMaterialIsAFaultUnlessItIsOnItsWayOut) {
  TickSample inside = Next();
  inside.density = 100.5;
  metrics_.OnSample(inside);  // free, and inside
  inside.mode = ProxyMode::kConstrained;
  metrics_.OnSample(inside);
  for (ProxyMode mode :
       {ProxyMode::kEjecting, ProxyMode::kSuspended, ProxyMode::kFault, ProxyMode::kInside}) {
    inside.mode = mode;
    metrics_.OnSample(inside);
  }
  EXPECT_EQ(Values().at("palpate_contact_faults_total"), 2);
  // On the surface is not inside it; and the other side is inside where above is free.
  TickSample on = Next();
  on.density = on.isovalue;
  metrics_.OnSample(on);
  EXPECT_EQ(Values().at("palpate_contact_faults_total"), 2);
  on.density = 99.0;
  on.free_side = FreeSide::kAbove;
  metrics_.OnSample(on);
  EXPECT_EQ(Values().at("palpate_contact_faults_total"), 3);
}

TEST_F(ServoMetricsTest, AForceAtTheLimitIsSaturated) {
  TickSample sample = Next();
  metrics_.OnSample(sample);
  sample.force_n = {3.0, 0.0, 0.0};
  metrics_.OnSample(sample);
  // Clamped, and rounded.
  sample.force_n = {3.3 * 0.6, 0.0, 3.3 * 0.8};
  metrics_.OnSample(sample);
  // No limit is left, and no force.
  sample.force_n = {};
  sample.force_limit_n = 0.0;
  metrics_.OnSample(sample);
  const auto values = Values();
  EXPECT_EQ(values.at("palpate_saturated_ticks_total"), 1);
  EXPECT_EQ(values.at("palpate_force_newtons_count"), 4);
  EXPECT_EQ(values.at("palpate_force_newtons_bucket{le=\"0\"}"), 2);
}

TEST_F(ServoMetricsTest, APeriodIsFromStartToStartAndALostSampleHasNone) {
  metrics_.OnSample(Next());
  tick_ += 500;
  TickSample sample = Next();
  metrics_.OnSample(sample);
  for (std::int64_t late_ns : {0, 30'000, 4'000'000}) {
    TickSample next = Next();
    next.time_ns = sample.time_ns + 1'000'000 + late_ns;
    metrics_.OnSample(next);
    sample = next;
  }
  const auto values = Values();
  EXPECT_EQ(values.at("palpate_tick_period_seconds_count"), 3);
  EXPECT_NEAR(values.at("palpate_tick_period_seconds_sum"), 0.00703, 1e-9);
  EXPECT_EQ(values.at("palpate_tick_period_seconds_bucket{le=\"0.001\"}"), 1);
  EXPECT_EQ(values.at("palpate_tick_period_seconds_bucket{le=\"0.00105\"}"), 2);
  EXPECT_EQ(values.at("palpate_tick_period_seconds_bucket{le=\"0.005\"}"), 3);
}

}  // namespace
}  // namespace palpate
