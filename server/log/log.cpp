#include "server/log/log.h"

#include <spdlog/spdlog.h>

#include <cstdint>
#include <optional>

#include "server/log/line_budget.h"
#include "server/realtime/tick_timer.h"

namespace palpate {
namespace {

spdlog::level::level_enum ToSpdlog(LogLevel level) {
  switch (level) {
    case LogLevel::kDebug:
      return spdlog::level::debug;
    case LogLevel::kInfo:
      return spdlog::level::info;
    case LogLevel::kWarning:
      return spdlog::level::warn;
    case LogLevel::kError:
      break;
  }
  return spdlog::level::err;
}

}  // namespace

bool IsLogged(LogLevel level) { return spdlog::should_log(ToSpdlog(level)); }

void LogLine(LogLevel level, std::string_view text) {
  spdlog::default_logger_raw()->log(ToSpdlog(level),
                                    spdlog::string_view_t(text.data(), text.size()));
}

bool LogLineOfClient(LogLevel level, const std::string& whose, std::string_view text) {
  // Never destroyed: gRPC's threads may outlive main.
  static auto& budget = *new LineBudget;
  if (!IsLogged(level)) return false;
  const std::optional<std::uint64_t> left_out = budget.Take(whose, MonotonicNowNs());
  if (!left_out) return false;
  LogLine(level, *left_out == 0 ? std::string(text)
                                : fmt::format("{} (and {} more since)", text, *left_out));
  return true;
}

}  // namespace palpate
