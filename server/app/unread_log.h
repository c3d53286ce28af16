// Keeps a log that nobody reads from stopping the daemon: a sink in front of another that
// writes to stderr. While stderr takes nothing (a full pipe, a stopped terminal) lines are
// dropped, and counted in a line of their own once it takes some again.
//
// Lines must be shorter than PIPE_BUF: a pipe with room takes one of them at once.
// Threads: any. It waits for 200 ms at most when stderr fills up, and not at all after that.
#pragma once

#include <spdlog/common.h>

#include <memory>

namespace palpate {

std::shared_ptr<spdlog::sinks::sink> DroppingWhileUnread(
    std::shared_ptr<spdlog::sinks::sink> to_stderr);

}  // namespace palpate
