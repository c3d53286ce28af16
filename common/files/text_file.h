// Reads a text file that a user names.
//
// Threads: any.
#pragma once

#include <cstddef>
#include <filesystem>
#include <string>

namespace palpate {

// Never waits for a pipe, and never reads more than `most_bytes`. Throws Error: kNotFound,
// kPermissionDenied or kUnavailable, by what the system says; kInvalidArgument for what is no
// regular file, or longer.
std::string ReadTextFile(const std::filesystem::path& path, std::size_t most_bytes);

}  // namespace palpate
