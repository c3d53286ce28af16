#include "server/device/usb/device_log.h"

#include <gtest/gtest.h>

#include <string>
#include <vector>

namespace palpate {
namespace {

std::vector<std::string> Lines(DeviceLog& log) {
  std::vector<std::string> lines;
  while (const std::optional<DeviceEvent> event = log.Next()) lines.push_back(event->text);
  return lines;
}

std::string Problem(const DeviceLog& log) {
  DeviceHealth health;
  log.FillIn(health);
  return health.problem;
}

TEST(DeviceLog, HasOneLinePerChange) {
  DeviceLog log("falcon");
  for (int i = 0; i < 3; ++i) log.SetProblem("not found: plug it in");
  EXPECT_EQ(Problem(log), "not found: plug it in");
  log.SetProblem("in use");
  log.SetConnected("1-2.3", "");
  EXPECT_EQ(Problem(log), "");
  log.SetConnected("1-2", "serial 7");
  log.SetProblem("in use");
  EXPECT_EQ(Lines(log), (std::vector<std::string>{"falcon: not found: plug it in", "falcon: in use",
                                                  "falcon on USB port 1-2.3: connected",
                                                  "falcon on USB port 1-2: connected, serial 7",
                                                  "falcon: in use"}));
  EXPECT_FALSE(log.Next().has_value());
}

TEST(DeviceLog, LosesTheOldestWhereNobodyReads) {
  DeviceLog log("falcon");
  for (int i = 0; i < 1000; ++i) log.Add(DeviceEvent::Level::kInfo, std::to_string(i));
  const std::vector<std::string> lines = Lines(log);
  ASSERT_EQ(lines.size(), DeviceLog::kMaxEvents);
  EXPECT_EQ(lines.back(), "falcon: 999");
}

}  // namespace
}  // namespace palpate
