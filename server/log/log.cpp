#include "server/log/log.h"

#include <spdlog/spdlog.h>

namespace palpate {
namespace {

spdlog::level::level_enum ToSpdlog(LogLevel level) {
  switch (level) {
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

}  // namespace palpate
