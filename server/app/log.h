// How the log is written: to stderr, with a time and a level; or for the journal of
// systemd, which has times of its own and reads levels from a prefix (sd-daemon(3)).
//
// A line that is the same as the one before is left out for five seconds; how often is
// said with the next one. Threads: main, before others start; SetLogLevel on any.
#pragma once

#include <array>
#include <string>
#include <string_view>

namespace palpate {

inline constexpr std::array<std::string_view, 4> kLogLevels = {"debug", "info", "warning", "error"};

// $JOURNAL_STREAM names what stderr is.
bool StderrIsJournal();

void SetUpLog(bool to_journal);

// One of kLogLevels; Error (kInvalidArgument).
void CheckLogLevel(const std::string& name);
void SetLogLevel(const std::string& name);

}  // namespace palpate
