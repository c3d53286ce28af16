// Keeps a log that nobody reads from blocking the daemon. This sink stands in front of a sink that
// writes to stderr. While stderr takes nothing (a full pipe, a stopped terminal), this sink drops
// lines. Once stderr takes lines again, one line says how many were dropped.
//
// Lines must be shorter than PIPE_BUF: a pipe with room takes such a line at once.
// Threads: any. Waits at most 200 ms when stderr becomes full; later calls do not wait.
#pragma once

#include <spdlog/common.h>

#include <memory>

namespace palpate {

std::shared_ptr<spdlog::sinks::sink> DroppingWhileUnread(
    std::shared_ptr<spdlog::sinks::sink> to_stderr);

}  // namespace palpate
