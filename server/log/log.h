// Writes lines to the daemon's log. server/app/log.h says where they go.
//
// These functions format the text in fmt's library and pass it on. spdlog's own calls would compile
// fmt's whole formatter into every file that logs, which costs 5 s of CPU per file.
// Clients cause LogOfClient's lines. All of them come from one budget (line_budget.h), so that no
// client can fill the log.
// Threads: any except the servo thread. Errors: none. A line that cannot be written is dropped.
#pragma once

#include <fmt/core.h>

#include <string>
#include <string_view>
#include <utility>

namespace palpate {

enum class LogLevel { kDebug, kInfo, kWarning, kError };

bool IsLogged(LogLevel level);
void LogLine(LogLevel level, std::string_view text);

template <class... Arguments>
void Log(LogLevel level, fmt::format_string<Arguments...> format, Arguments&&... arguments) {
  if (IsLogged(level)) LogLine(level, fmt::format(format, std::forward<Arguments>(arguments)...));
}
template <class... Arguments>
void LogInfo(fmt::format_string<Arguments...> format, Arguments&&... arguments) {
  Log(LogLevel::kInfo, format, std::forward<Arguments>(arguments)...);
}
template <class... Arguments>
void LogWarning(fmt::format_string<Arguments...> format, Arguments&&... arguments) {
  Log(LogLevel::kWarning, format, std::forward<Arguments>(arguments)...);
}
template <class... Arguments>
void LogError(fmt::format_string<Arguments...> format, Arguments&&... arguments) {
  Log(LogLevel::kError, format, std::forward<Arguments>(arguments)...);
}

// `whose`: the client's identity or peer, as in LineBudget. True if the line was written.
bool LogLineOfClient(LogLevel level, const std::string& whose, std::string_view text);
template <class... Arguments>
bool LogOfClient(LogLevel level, const std::string& whose, fmt::format_string<Arguments...> format,
                 Arguments&&... arguments) {
  return LogLineOfClient(level, whose, fmt::format(format, std::forward<Arguments>(arguments)...));
}

}  // namespace palpate
