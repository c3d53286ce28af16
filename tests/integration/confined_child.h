// The attempts of confined_child, and the objects that they use.
#pragma once

#include <fcntl.h>
#include <sys/types.h>

#include <functional>
#include <span>
#include <string>
#include <string_view>

namespace palpate {

// Set before Confine().
inline pid_t parent = 0;
inline int memory_file = -1;
inline int pipe_to_write = -1;
inline std::string readable_file;
inline std::string other_file;
inline std::string new_file;
inline std::string parents_memory;
inline std::string memory_file_path;
inline char bytes[4096];

inline int Open(const std::string& path, int flags) {
  return open(path.c_str(), flags | O_CLOEXEC, 0600);
}

// The guard that refuses an attack: Landlock, the filter of system calls, or both. kKills: the
// filter, which ends the process. Sanitizer builds have only kFiles.
enum class Guard { kFiles, kCalls, kBoth, kKills };
// The result without Confine() and without privileges.
enum class Free { kSucceeds, kUnknown };

struct Attack {
  const char* name;
  Guard guard;
  Free free;
  std::function<long()> attempt;  // returns -1 and sets errno, as a system call
};

// Attempts that only an attacker makes.
std::span<const Attack> Attacks();

// An action of readers. Throws if it fails.
struct Work {
  const char* name;
  void (*done)();
};

std::span<const Work> Works();

// The name of the entry of Works() that exceeds its time limit.
inline constexpr std::string_view kTimeout = "run_out_of_time";
inline constexpr std::string_view kManyThreads = "many_threads";

// Throws an error with errno if not `done`.
void Check(bool done, const char* what);

}  // namespace palpate
