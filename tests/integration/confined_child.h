// What confined_child tries, and what it tries it on.
#pragma once

#include <fcntl.h>
#include <sys/types.h>

#include <span>
#include <string>
#include <string_view>

namespace palpate {

// Made before Confine().
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

// What refuses it. Sanitizer builds have kFiles alone.
enum class Guard { kFiles, kCalls, kBoth };
// What becomes of the process.
enum class End { kLives, kKilled };
// What happens without Confine() and without privileges.
enum class Free { kSucceeds, kUnknown };

struct Attack {
  const char* name;
  Guard guard;
  End end;
  Free free;
  long (*attempt)();  // as a system call: -1 and errno
};

// What only an attacker does.
std::span<const Attack> Attacks();

// What readers do. Throws where it does not succeed.
struct Work {
  const char* name;
  void (*done)();
};

std::span<const Work> Works();

// Of Works(): it takes longer than it may.
inline constexpr std::string_view kTimeout = "run_out_of_time";

// Throws with errno.
void Check(bool done, const char* what);

}  // namespace palpate
