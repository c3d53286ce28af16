// Sets up the log on stderr. Each line has a time and a level. For systemd's journal, which has its
// own times, a line has a level prefix instead (sd-daemon(3)).
//
// A line that repeats the previous one is left out for five seconds. The next line then says how
// often. Threads: main, before other threads start; SetLogLevel on any thread.
#pragma once

#include <array>
#include <string>
#include <string_view>

namespace palpate {

inline constexpr std::array<std::string_view, 4> kLogLevels = {"debug", "info", "warning", "error"};

// True if stderr is the stream that $JOURNAL_STREAM names.
bool StderrIsJournal();

void SetUpLog(bool to_journal);

// Throws Error (kInvalidArgument) if `name` is not one of kLogLevels.
void CheckLogLevel(const std::string& name);
void SetLogLevel(const std::string& name);

}  // namespace palpate
