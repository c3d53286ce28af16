#include "server/device/stream/device_log.h"

#include <utility>

namespace palpate {

DeviceLog::DeviceLog(std::string name) : name_(std::move(name)) {}

void DeviceLog::SetProblem(const std::string& problem, DeviceEvent::Level level) {
  const std::lock_guard lock(mutex_);
  if (problem == problem_) return;
  problem_ = problem;
  if (!problem.empty()) Push(level, name_ + ": " + problem);
}

void DeviceLog::SetConnected(const std::string& place, const std::string& identity) {
  const std::lock_guard lock(mutex_);
  problem_.clear();
  identity_ = identity;
  Push(DeviceEvent::Level::kInfo, name_ + (place.empty() ? "" : " on " + place) + ": connected" +
                                      (identity.empty() ? "" : ", " + identity));
}

void DeviceLog::Add(DeviceEvent::Level level, const std::string& text) {
  const std::lock_guard lock(mutex_);
  Push(level, name_ + ": " + text);
}

std::optional<DeviceEvent> DeviceLog::Next() {
  const std::lock_guard lock(mutex_);
  if (events_.empty()) return std::nullopt;
  DeviceEvent event = std::move(events_.front());
  events_.pop_front();
  return event;
}

void DeviceLog::FillIn(DeviceHealth& health) const {
  const std::lock_guard lock(mutex_);
  health.identity = identity_;
  health.problem = problem_;
}

void DeviceLog::Push(DeviceEvent::Level level, std::string text) {
  if (events_.size() == kMaxEvents) events_.pop_front();
  events_.push_back({.level = level, .text = std::move(text)});
}

}  // namespace palpate
